// First the nearest known row within every column, by a sweep down and one up; then for every unknown pixel
// the columns to its left and right, outwards, until they alone are farther than the best pixel so far.

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <vector>

#include "ops/common/elements.h"
#include "ops/fill/mirror_op.h"

namespace slide::ops {
namespace {

constexpr std::int64_t kColumnGrain = 64;
constexpr std::int64_t kRowGrain = 8;
constexpr std::int32_t kNone = -1;

/// rows[i, j]: the known row of column j nearest to i, the upper one of two; columns [begin, end).
void nearest_rows(const float* weight, const Nchw& s, std::int64_t begin, std::int64_t end,
                  std::int32_t* rows) {
  const auto known = [&](std::int64_t at) { return weight[at] >= static_cast<float>(kKnown); };
  for (std::int64_t i = 0; i < s.h; ++i)
    for (std::int64_t at = i * s.w + begin; at < i * s.w + end; ++at)
      rows[at] = known(at) ? static_cast<std::int32_t>(i) : i == 0 ? kNone : rows[at - s.w];
  std::vector<std::int64_t> below(static_cast<std::size_t>(end - begin), kNone);
  for (std::int64_t i = s.h - 1; i >= 0; --i)
    for (std::int64_t j = begin; j < end; ++j) {
      const std::int64_t at = i * s.w + j;
      std::int64_t& under = below[static_cast<std::size_t>(j - begin)];
      if (known(at)) under = i;
      if (under != kNone && (rows[at] == kNone || under - i < i - rows[at]))
        rows[at] = static_cast<std::int32_t>(under);
    }
}

struct Nearest {
  std::int64_t distance = std::numeric_limits<std::int64_t>::max();
  std::int64_t row = 0;
  std::int64_t column = 0;

  void offer(std::int64_t d, std::int64_t r, std::int64_t c) {
    if (d < distance || (d == distance && (r < row || (r == row && c < column)))) *this = {d, r, c};
  }
};

/// The known pixel nearest to column j of row i; `rows` is that row of nearest_rows().
Nearest nearest(const std::int32_t* rows, std::int64_t w, std::int64_t i, std::int64_t j) {
  Nearest best;
  const std::int64_t reach = std::max(j, w - 1 - j);
  for (std::int64_t k = 0; k <= reach && k * k <= best.distance; ++k)
    for (const std::int64_t column : {j - k, j + k}) {
      if (column < 0 || column >= w || rows[column] == kNone) continue;
      const std::int64_t down = i - rows[column];
      best.offer(k * k + down * down, rows[column], column);
    }
  return best;
}

std::int64_t mirrored(std::int64_t centre, std::int64_t t, std::int64_t size) {
  const std::int64_t far = std::abs(2 * centre - t);
  return std::min(far, 2 * (size - 1) - far);
}

class MirrorKnownKernel : public Kernel {
 public:
  [[nodiscard]] std::string_view name() const override { return "mirror_known.columns"; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }
  [[nodiscard]] std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    return static_cast<std::size_t>(nchw(inputs[0]).plane()) * sizeof(std::int32_t);
  }
  /// Values are copied.
  [[nodiscard]] double error_factor(const Op& /*op*/, std::span<const Shape> /*inputs*/) const override {
    return 0;
  }

  void run(const Op& /*op*/, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& call) const override {
    const Nchw s = nchw(inputs[0].shape());
    auto* rows = static_cast<std::int32_t*>(static_cast<void*>(call.scratch.data()));
    for (std::int64_t n = 0; n < s.n; ++n) {
      const float* weight = f32(inputs[1]) + n * s.plane();
      for_ranges(s.w, kColumnGrain,
                 [&](std::int64_t begin, std::int64_t end) { nearest_rows(weight, s, begin, end, rows); });
      const float* x = f32(inputs[0]) + n * s.c * s.plane();
      float* y = f32(output) + n * s.c * s.plane();
      // Every column knows a row or none; with none at all there is nothing to mirror at.
      const bool any = std::any_of(rows, rows + s.w, [](std::int32_t row) { return row != kNone; });
      for_ranges(s.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
        for (std::int64_t i = begin; i < end; ++i)
          for (std::int64_t j = 0; j < s.w; ++j) {
            const std::int64_t at = i * s.w + j;
            std::int64_t from = at;
            if (any && weight[at] < static_cast<float>(kKnown)) {
              const Nearest q = nearest(rows + i * s.w, s.w, i, j);
              from = mirrored(q.row, i, s.h) * s.w + mirrored(q.column, j, s.w);
            }
            for (std::int64_t c = 0; c < s.c; ++c) y[c * s.plane() + at] = x[c * s.plane() + from];
          }
      });
    }
  }
};

const MirrorKnownKernel kMirror;
const Kernel* const kKernels[] = {&kMirror};

}  // namespace

std::span<const Kernel* const> MirrorKnownOp::kernels() const { return kKernels; }

}  // namespace slide::ops
