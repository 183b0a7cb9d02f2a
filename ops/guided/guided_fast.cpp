// Box sums in float64: variances are differences of nearly equal numbers, which float32 could not hold at
// small eps. A run of rows sums its moments along each row first and down the rows then; every element is
// summed in one order, whatever the run it is in. The fitted coefficients wait in scratch for the second
// round of means.

#include <algorithm>
#include <vector>

#include "ops/common/elements.h"
#include "ops/guided/guided_op.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kRowsPerTask = 16;

/// Sums over the windows around a run of rows, of several planes at once.
class BoxSums {
 public:
  BoxSums(const Nchw& s, std::int64_t radius, std::size_t planes, std::int64_t first)
      : h_(s.h),
        w_(s.w),
        down_(std::min(radius, s.h - 1)),
        along_(std::min(radius, s.w - 1)),
        top_(std::max<std::int64_t>(0, first - down_)),
        bottom_(std::min(s.h, std::min(s.h, first + kRowsPerTask) + down_)),
        planes_(planes),
        rows_(planes * static_cast<std::size_t>((bottom_ - top_) * w_)),
        padded_(static_cast<std::size_t>(w_ + 2 * along_)) {}

  /// Reads all rows that are needed: fill(plane, row, values) writes the `w` values of one.
  template <typename Fill>
  void read(const Fill& fill) {
    for (std::size_t plane = 0; plane < planes_; ++plane)
      for (std::int64_t i = top_; i < bottom_; ++i) {
        fill(plane, i, padded_.data() + along_);
        add_along(row(plane, i));
      }
  }

  /// The sums of row i of a plane.
  void sums(std::size_t plane, std::int64_t i, double* y) {
    std::fill_n(y, w_, 0.0);
    for (std::int64_t k = first_row(i); k < last_row(i); ++k) {
      const double* x = row(plane, k);
      for (std::int64_t j = 0; j < w_; ++j) y[j] += x[j];
    }
  }

  /// Pixels of the window around (i, j).
  [[nodiscard]] double pixels(std::int64_t i, std::int64_t j) const {
    const std::int64_t columns = std::min(w_, j + along_ + 1) - std::max<std::int64_t>(0, j - along_);
    return static_cast<double>((last_row(i) - first_row(i)) * columns);
  }

 private:
  [[nodiscard]] std::int64_t first_row(std::int64_t i) const { return std::max<std::int64_t>(0, i - down_); }
  [[nodiscard]] std::int64_t last_row(std::int64_t i) const { return std::min(h_, i + down_ + 1); }
  double* row(std::size_t plane, std::int64_t i) {
    return rows_.data() + (static_cast<std::int64_t>(plane) * (bottom_ - top_) + i - top_) * w_;
  }

  void add_along(double* y) {
    std::fill_n(y, w_, 0.0);
    for (std::int64_t k = 0; k <= 2 * along_; ++k) {
      const double* x = padded_.data() + k;
      for (std::int64_t j = 0; j < w_; ++j) y[j] += x[j];
    }
  }

  std::int64_t h_, w_, down_, along_, top_, bottom_;
  std::size_t planes_;
  std::vector<double> rows_;
  std::vector<double> padded_;  // a row with zeros to both sides
};

/// The planes that are summed: x, the guide's, their products with x, the products of pairs d <= c.
struct Moments {
  const float* guide;
  const float* x;
  const Nchw& s;

  [[nodiscard]] std::size_t guides() const { return static_cast<std::size_t>(s.c); }
  [[nodiscard]] std::size_t pair(std::size_t c, std::size_t d) const {
    return 1 + 2 * guides() + c * (c + 1) / 2 + d;
  }
  [[nodiscard]] std::size_t count() const { return pair(guides(), 0); }

  void fill(std::size_t plane, std::int64_t i, double* values) const {
    if (plane == 0) return product(nullptr, x + i * s.w, values);
    if (plane <= guides()) return product(nullptr, row(plane - 1, i), values);
    if (plane <= 2 * guides()) return product(x + i * s.w, row(plane - 1 - guides(), i), values);
    std::size_t c = 0;
    while (pair(c + 1, 0) <= plane) ++c;
    product(row(c, i), row(plane - pair(c, 0), i), values);
  }

 private:
  [[nodiscard]] const float* row(std::size_t c, std::int64_t i) const {
    return guide + static_cast<std::int64_t>(c) * s.plane() + i * s.w;
  }
  /// Exact: a product of two float32 numbers fits into float64.
  void product(const float* a, const float* b, double* y) const {
    for (std::int64_t j = 0; j < s.w; ++j)
      y[j] = (a == nullptr ? 1.0 : static_cast<double>(a[j])) * static_cast<double>(b[j]);
  }
};

/// a and b of the windows of row i, into planes of `fitted`.
void fit_row(const Moments& moments, BoxSums& box, std::int64_t i, double eps, std::vector<double>& sums,
             double* fitted) {
  const Nchw& s = moments.s;
  const std::size_t n = moments.guides();
  for (std::size_t k = 0; k < moments.count(); ++k)
    box.sums(k, i, sums.data() + k * static_cast<std::size_t>(s.w));
  for (std::int64_t j = 0; j < s.w; ++j) {
    const double pixels = box.pixels(i, j);
    const auto mean = [&](std::size_t k) {
      return sums[k * static_cast<std::size_t>(s.w) + static_cast<std::size_t>(j)] / pixels;
    };
    SmallSystem system;
    system.count = n;
    const double mean_x = mean(0);
    for (std::size_t c = 0; c < n; ++c) {
      const double mean_c = mean(1 + c);
      system.vector[c] = mean(1 + n + c) - mean_c * mean_x;
      for (std::size_t d = 0; d <= c; ++d)
        system.matrix[c * n + d] = mean(moments.pair(c, d)) - mean_c * mean(1 + d);
      system.matrix[c * n + c] += eps;
    }
    system.solve();
    double b = mean_x;
    for (std::size_t c = 0; c < n; ++c) {
      fitted[static_cast<std::int64_t>(c) * s.plane() + i * s.w + j] = system.vector[c];
      b -= system.vector[c] * mean(1 + c);
    }
    fitted[s.c * s.plane() + i * s.w + j] = b;
  }
}

class GuidedCoefficientsKernel : public Kernel {
 public:
  [[nodiscard]] std::string_view name() const override { return "guided_coefficients.boxes"; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }
  [[nodiscard]] std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                                          const Shape& output) const override {
    return static_cast<std::size_t>(output.count()) * sizeof(double);
  }
  /// The result is rounded to float32 once; what float64 loses is in the scale.
  [[nodiscard]] double error_factor(const Op& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(2);
  }

  void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& call) const override {
    const auto& guided = static_cast<const GuidedCoefficientsOp&>(op);
    const Nchw s = nchw(inputs[0].shape());
    auto* fitted = static_cast<double*>(static_cast<void*>(call.scratch.data()));
    fit_all(guided, inputs, s, fitted);
    average_all(guided, s, fitted, f32(output));
  }

 private:
  static void fit_all(const GuidedCoefficientsOp& op, std::span<const Tensor> inputs, const Nchw& s,
                      double* fitted) {
    const std::int64_t tasks = (s.h + kRowsPerTask - 1) / kRowsPerTask;
    for_ranges(s.n * tasks, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t n = task / tasks;
      const std::int64_t first = task % tasks * kRowsPerTask;
      const Moments moments{f32(inputs[0]) + n * s.c * s.plane(), f32(inputs[1]) + n * s.plane(), s};
      BoxSums box(s, op.radius(), moments.count(), first);
      box.read([&](std::size_t plane, std::int64_t i, double* values) { moments.fill(plane, i, values); });
      std::vector<double> sums(moments.count() * static_cast<std::size_t>(s.w));
      for (std::int64_t i = first; i < std::min(s.h, first + kRowsPerTask); ++i)
        fit_row(moments, box, i, op.eps(), sums, fitted + n * (s.c + 1) * s.plane());
    });
  }

  static void average_all(const GuidedCoefficientsOp& op, const Nchw& s, const double* fitted, float* y) {
    const std::int64_t tasks = (s.h + kRowsPerTask - 1) / kRowsPerTask;
    for_ranges(s.n * (s.c + 1) * tasks, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t plane = task / tasks * s.plane();
      const std::int64_t first = task % tasks * kRowsPerTask;
      BoxSums box(s, op.radius(), 1, first);
      box.read([&](std::size_t, std::int64_t i, double* values) {
        std::copy_n(fitted + plane + i * s.w, s.w, values);
      });
      std::vector<double> sums(static_cast<std::size_t>(s.w));
      for (std::int64_t i = first; i < std::min(s.h, first + kRowsPerTask); ++i) {
        box.sums(0, i, sums.data());
        for (std::int64_t j = 0; j < s.w; ++j)
          y[plane + i * s.w + j] = static_cast<float>(sums[static_cast<std::size_t>(j)] / box.pixels(i, j));
      }
    });
  }
};

const GuidedCoefficientsKernel kGuided;
const Kernel* const kKernels[] = {&kGuided};

}  // namespace

std::span<const Kernel* const> GuidedCoefficientsOp::kernels() const { return kKernels; }

}  // namespace slide::ops
