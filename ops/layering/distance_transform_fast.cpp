// Two passes, each O(pixels). First every column: distances to its nearest marked pixel, downwards and
// upwards, kept in the output. Then every row: column k is the parabola (j - k)² + g(k)² over j, and the
// result is the lower envelope of the row's parabolas (Felzenszwalb and Huttenlocher, "Distance Transforms of
// Sampled Functions", 2012), found with a stack that one sweep to the right builds and one to the left reads.
// Both passes are in integers, as Meijster, Roerdink and Hesselink ("A general algorithm for computing
// distance transforms in linear time", 2000) have them, so that where two parabolas cross is never a matter
// of rounding.

#include <algorithm>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/layering/distance_transform.h"

namespace slide::ops {
namespace {

/// Columns per task of the first pass: whole cache lines.
constexpr std::int64_t kColumnGrain = 64;
constexpr std::int64_t kRowGrain = 8;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Columns [begin, end) of a plane; distances below 2^24 are exact in float32.
void scan_columns(const float* x, const Nchw& shape, std::int64_t begin, std::int64_t end, float* distance) {
  for (std::int64_t i = 0; i < shape.h; ++i) {
    const float* from = x + i * shape.w;
    float* here = distance + i * shape.w;
    for (std::int64_t j = begin; j < end; ++j)
      here[j] = from[j] > 0.5F ? 0.0F : i > 0 ? here[j - shape.w] + 1 : kInfinity;
  }
  for (std::int64_t i = shape.h - 1; i-- > 0;) {
    float* here = distance + i * shape.w;
    for (std::int64_t j = begin; j < end; ++j) here[j] = std::min(here[j], here[j + shape.w] + 1);
  }
}

/// A column's parabola over a row.
struct Parabola {
  std::int64_t column;
  std::int64_t height;  ///< square of the distance along the column
  std::int64_t from;    ///< the first j at which it is the lowest of all up to its own column

  [[nodiscard]] std::int64_t at(std::int64_t j) const noexcept {
    return (j - column) * (j - column) + height;
  }
  /// The last j at which this one is not above a parabola farther to the right. Not negative if this one is
  /// not above that one at some j >= 0.
  [[nodiscard]] std::int64_t last_before(const Parabola& right) const noexcept {
    return (right.column * right.column - column * column + right.height - height) /
           (2 * (right.column - column));
  }
};

/// Replaces a row of distances along columns by the squared distances.
void lower_envelope(float* row, std::int64_t width, std::vector<Parabola>& stack) {
  stack.clear();
  for (std::int64_t k = 0; k < width; ++k) {
    if (row[k] == kInfinity) continue;
    const auto g = static_cast<std::int64_t>(row[k]);
    Parabola next{k, g * g, 0};
    while (!stack.empty() && stack.back().at(stack.back().from) > next.at(stack.back().from))
      stack.pop_back();
    if (!stack.empty()) next.from = stack.back().last_before(next) + 1;
    if (next.from < width) stack.push_back(next);
  }
  if (stack.empty()) return;  // infinity already
  for (std::int64_t j = width; j-- > 0;) {
    row[j] = static_cast<float>(stack.back().at(j));
    if (stack.back().from == j && j > 0) stack.pop_back();
  }
}

class DistanceTransformKernel : public Kernel {
 public:
  [[nodiscard]] std::string_view name() const override { return "distance_transform.envelope"; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }

  [[nodiscard]] double error_factor(const Op& /*op*/, std::span<const Shape> inputs) const override {
    const Nchw in = nchw(inputs[0]);
    return (in.h - 1) * (in.h - 1) + (in.w - 1) * (in.w - 1) <= std::int64_t{1} << 24 ? 0 : 1;
  }

  void run(const Op& /*op*/, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& /*call*/) const override {
    const Nchw in = nchw(output.shape());
    const std::int64_t planes = in.n * in.c;
    const std::int64_t strips = (in.w + kColumnGrain - 1) / kColumnGrain;
    for_ranges(planes * strips, 1, [&](std::int64_t task, std::int64_t) {
      const std::int64_t plane = task / strips * in.plane();
      const std::int64_t first = task % strips * kColumnGrain;
      scan_columns(f32(inputs[0]) + plane, in, first, std::min(first + kColumnGrain, in.w),
                   f32(output) + plane);
    });
    for_ranges(planes * in.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
      std::vector<Parabola> stack;
      stack.reserve(static_cast<std::size_t>(in.w));
      for (std::int64_t i = begin; i < end; ++i) lower_envelope(f32(output) + i * in.w, in.w, stack);
    });
  }
};

const DistanceTransformKernel kEnvelope;
const Kernel* const kKernels[] = {&kEnvelope};

}  // namespace

std::span<const Kernel* const> DistanceTransformOp::kernels() const { return kKernels; }

}  // namespace slide::ops
