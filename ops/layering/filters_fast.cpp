#include <algorithm>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/layering/layering_ops.h"
#include "ops/layering/layering_routines.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)  \
  namespace level {                       \
  extern const LayeringRoutines layering; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const LayeringRoutines* const> layering_routines() {
#define SLIDE_LIST(level, enumerator) &level::layering,
  static constexpr const LayeringRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

constexpr std::int64_t kRowsPerTask = 16;

/// Row i of a plane, the border replicated.
const float* replicated_row(const float* plane, const Nchw& in, std::int64_t i) {
  return plane + std::clamp<std::int64_t>(i, 0, in.h - 1) * in.w;
}

/// Replicates the two ends of a row into `margin` elements before and after it.
void replicate_ends(float* row, std::int64_t width, std::int64_t margin) {
  std::fill(row - margin, row, row[0]);
  std::fill(row + width, row + width + margin, row[width - 1]);
}

/// Calls body(plane, first row, end of rows) for runs of rows of all planes, in parallel.
template <typename Body>
void for_row_runs(const Nchw& in, Body body) {
  const std::int64_t runs = (in.h + kRowsPerTask - 1) / kRowsPerTask;
  for_ranges(in.n * in.c * runs, 1, [&](std::int64_t task, std::int64_t) {
    const std::int64_t first = task % runs * kRowsPerTask;
    body(task / runs, first, std::min(in.h, first + kRowsPerTask));
  });
}

class GaussianBlurKernel : public LevelKernel<GaussianBlurOp, LayeringRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// In each direction a tap is rounded, the pair it multiplies, the product, and up to radius + 1 sums.
  [[nodiscard]] double factor(const GaussianBlurOp& op, std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(2.0 * (static_cast<double>(op.taps().size()) + 3));
  }

  void compute(const GaussianBlurOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(output.shape());
    const std::vector<double> exact = op.taps();
    std::vector<float> taps(exact.size());
    std::ranges::transform(exact, taps.begin(), [](double tap) { return static_cast<float>(tap); });
    for_row_runs(in, [&](std::int64_t plane, std::int64_t first, std::int64_t end) {
      blur_rows(taps, in, f32(inputs[0]) + plane * in.plane(), f32(output) + plane * in.plane(), first, end);
    });
  }

  void blur_rows(const std::vector<float>& taps, const Nchw& in, const float* x, float* y, std::int64_t first,
                 std::int64_t end) const {
    const auto radius = static_cast<std::int64_t>(taps.size()) - 1;
    const auto r = static_cast<std::size_t>(radius);
    const auto width = static_cast<std::size_t>(in.w);
    std::vector<float> buffer(width + 2 * r);
    float* const row = buffer.data() + radius;
    std::vector<const float*> rows(2 * r + 1);
    for (std::int64_t i = first; i < end; ++i) {
      for (std::int64_t k = -radius; k <= radius; ++k)
        rows[static_cast<std::size_t>(k + radius)] = replicated_row(x, in, i + k);
      routines().symmetric_sum(rows.data() + radius, taps.data(), r, row, width);
      replicate_ends(row, in.w, radius);
      for (std::int64_t k = -radius; k <= radius; ++k) rows[static_cast<std::size_t>(k + radius)] = row + k;
      routines().symmetric_sum(rows.data() + radius, taps.data(), r, y + i * in.w, width);
    }
  }
};

class SobelKernel : public LevelKernel<SobelOp, LayeringRoutines> {
 public:
  using LevelKernel::LevelKernel;

 private:
  /// A difference and two sums; the weights are powers of two.
  [[nodiscard]] double factor(const SobelOp& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return rounding_factor(3);
  }

  void compute(const SobelOp& /*op*/, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> /*scratch*/) const override {
    const Nchw in = nchw(inputs[0].shape());
    for_row_runs(in, [&](std::int64_t n, std::int64_t first, std::int64_t end) {
      const float* x = f32(inputs[0]) + n * in.plane();
      float* y = f32(output) + 2 * n * in.plane();
      const auto width = static_cast<std::size_t>(in.w);
      std::vector<float> buffer(3 * (width + 2));
      for (std::int64_t i = first; i < end; ++i) {
        for (std::int64_t k = 0; k < 3; ++k) {
          float* row = buffer.data() + k * (in.w + 2) + 1;
          const float* from = replicated_row(x, in, i + k - 1);
          std::copy(from, from + in.w, row);
          replicate_ends(row, in.w, 1);
        }
        routines().sobel_row(buffer.data(), buffer.data() + width + 2, buffer.data() + 2 * (width + 2),
                             y + i * in.w, y + in.plane() + i * in.w, width);
      }
    });
  }
};

}  // namespace

std::span<const Kernel* const> GaussianBlurOp::kernels() const {
  static const KernelList<GaussianBlurKernel, LayeringRoutines> list("gaussian_blur.separable",
                                                                     layering_routines());
  return list.all();
}

std::span<const Kernel* const> SobelOp::kernels() const {
  static const KernelList<SobelKernel, LayeringRoutines> list("sobel.rows", layering_routines());
  return list.all();
}

}  // namespace slide::ops
