// Push-pull in float32. The pull pyramid of weights and weighted means is built once, level by level; the
// push ping-pongs between the output and one scratch picture. Rows run in parallel; each element is computed
// the same way whatever the thread.

#include <algorithm>
#include <cstring>
#include <vector>

#include "ops/common/elements.h"
#include "ops/fill/fill_op.h"

namespace slide::ops {
namespace {

/// Rows per task.
constexpr std::int64_t kRowGrain = 16;

struct Extent {
  std::int64_t h, w;
  [[nodiscard]] std::int64_t count() const noexcept { return h * w; }
};

/// The sizes of all levels, the picture's own first.
std::vector<Extent> level_sizes(const Nchw& s) {
  std::vector<Extent> sizes{{s.h, s.w}};
  while (sizes.back().count() > 1) sizes.push_back({(sizes.back().h + 1) / 2, (sizes.back().w + 1) / 2});
  return sizes;
}

/// One level of the pyramid: `planes` planes of values over `batch` planes of weights.
struct Level {
  Extent size;
  const float* x;
  const float* weight;
};

/// The two columns that a column of the finer level reads, and the second one's share.
struct Tap {
  std::int64_t first, second;
  float share;
};

Tap tap(std::int64_t i, std::int64_t coarse, std::int64_t fine) {
  const float c = std::max(
      0.0F,
      static_cast<float>(
          (static_cast<double>(i) + 0.5) * static_cast<double>(coarse) / static_cast<double>(fine) - 0.5));
  const auto first = std::min(static_cast<std::int64_t>(c), coarse - 1);
  return {first, std::min(first + 1, coarse - 1), c - static_cast<float>(first)};
}

constexpr float kEdge = static_cast<float>(kPull[0]);
constexpr float kMiddle = static_cast<float>(kPull[1]);

/// (1 3 3 1)/8 of four neighbours, always in this order.
float pulled(float a, float b, float c, float d) { return kEdge * (a + d) + kMiddle * (b + c); }

/// The next level of one plane: its weights (for the first channel) and weighted means, row i. A block of
/// columns is filtered down the rows, then along them; rows beyond the border count by a zero factor.
void pull_row(const float* x, const float* weight, Extent fine, float* coarse_x, float* coarse_weight,
              Extent coarse, std::int64_t i) {
  constexpr std::int64_t kBlock = 64;
  float sums[2 * kBlock + 2];
  float weights[2 * kBlock + 2];
  std::int64_t rows[4];
  float inside[4];
  for (std::int64_t u = 0; u < 4; ++u) {
    const std::int64_t y = 2 * i - 1 + u;
    inside[u] = y >= 0 && y < fine.h ? 1.0F : 0.0F;
    rows[u] = std::clamp<std::int64_t>(y, 0, fine.h - 1) * fine.w;
  }
  for (std::int64_t j0 = 0; j0 < coarse.w; j0 += kBlock) {
    const std::int64_t cells = std::min(kBlock, coarse.w - j0);
    const std::int64_t left = 2 * j0 - 1;
    std::fill_n(sums, 2 * cells + 2, 0.0F);
    std::fill_n(weights, 2 * cells + 2, 0.0F);
    const std::int64_t end = std::min(fine.w - left, 2 * cells + 2);
    for (std::int64_t v = std::max<std::int64_t>(0, -left); v < end; ++v) {
      float w[4];
      float p[4];
      for (std::int64_t u = 0; u < 4; ++u) {
        w[u] = inside[u] * weight[rows[u] + left + v];
        p[u] = w[u] * x[rows[u] + left + v];
      }
      weights[v] = pulled(w[0], w[1], w[2], w[3]);
      sums[v] = pulled(p[0], p[1], p[2], p[3]);
    }
    float* to = coarse_x + i * coarse.w + j0;
    for (std::int64_t j = 0; j < cells; ++j) {
      const float* w = weights + 2 * j;
      const float* p = sums + 2 * j;
      const float mean = pulled(w[0], w[1], w[2], w[3]);
      to[j] = pulled(p[0], p[1], p[2], p[3]) / std::max(mean, static_cast<float>(kLeastWeight));
      if (coarse_weight != nullptr)
        coarse_weight[i * coarse.w + j0 + j] = std::min(static_cast<float>(kTrust) * mean, 1.0F);
    }
  }
}

/// y = w·x + (1 - w)·(the level below enlarged), row i.
void blend_row(const float* x, const float* weight, const float* below, Extent coarse, Extent size,
               const std::vector<Tap>& columns, std::int64_t i, float* y) {
  const Tap row = tap(i, coarse.h, size.h);
  const float* top = below + row.first * coarse.w;
  const float* bottom = below + row.second * coarse.w;
  for (std::int64_t j = 0; j < size.w; ++j) {
    const Tap& c = columns[static_cast<std::size_t>(j)];
    const float above = (1 - c.share) * top[c.first] + c.share * top[c.second];
    const float under = (1 - c.share) * bottom[c.first] + c.share * bottom[c.second];
    const float w = weight[i * size.w + j];
    y[i * size.w + j] = w * x[i * size.w + j] + (1 - w) * ((1 - row.share) * above + row.share * under);
  }
}

/// One Jacobi step, row i.
void relax_row(const float* x, const float* weight, const float* before, Extent size, std::int64_t i,
               float* y) {
  const float* here = before + i * size.w;
  const float* above = before + std::max<std::int64_t>(i - 1, 0) * size.w;
  const float* under = before + std::min(i + 1, size.h - 1) * size.w;
  const auto one = [&](std::int64_t j, std::int64_t left, std::int64_t right) {
    const float w = weight[i * size.w + j];
    const float mean = (above[j] + under[j] + here[left] + here[right]) * 0.25F;
    y[i * size.w + j] = w * x[i * size.w + j] + (1 - w) * mean;
  };
  one(0, 0, std::min<std::int64_t>(1, size.w - 1));
  for (std::int64_t j = 1; j + 1 < size.w; ++j) one(j, j - 1, j + 1);
  if (size.w > 1) one(size.w - 1, size.w - 2, size.w - 1);
}

/// Calls row(plane, i) for all rows of all planes, in parallel.
template <typename Row>
void for_rows(std::int64_t planes, std::int64_t height, const Row& row) {
  for_ranges(planes * height, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t r = begin; r < end; ++r) row(r / height, r % height);
  });
}

class PushPullKernel : public Kernel {
 public:
  [[nodiscard]] std::string_view name() const override { return "push_pull_fill.rows"; }
  [[nodiscard]] Isa isa() const override { return Isa::kBaseline; }
  [[nodiscard]] bool supports(const Op& /*op*/, std::span<const Shape> /*inputs*/,
                              const Shape& /*output*/) const override {
    return true;
  }

  [[nodiscard]] std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    const Nchw s = nchw(inputs[0]);
    std::int64_t floats = s.n * s.c * s.plane();
    for (const Extent& e : level_sizes(s)) floats += (s.n * s.c + s.n) * e.count();
    return static_cast<std::size_t>(floats) * sizeof(float);
  }

  /// A level's weights carry at most 6 roundings more than the last one's (3 along each side), its means
  /// 2·6·level + 14 through them, the blend and its sweeps 2·6·level together, as a sweep leaves 1 - w of
  /// what was wrong before; the enlargement adds 8, the blend 4, each sweep 8. All else averages, which does
  /// not grow errors.
  [[nodiscard]] double error_factor(const Op& op, std::span<const Shape> inputs) const override {
    const auto levels = static_cast<double>(level_sizes(nchw(inputs[0])).size());
    const double sweeps = static_cast<const PushPullFillOp&>(op).sweeps();
    return rounding_factor(levels * (12 * levels + 26 + 8 * sweeps));
  }

  void run(const Op& op, std::span<const Tensor> inputs, Tensor& output,
           const KernelCall& call) const override {
    const Nchw s = nchw(inputs[0].shape());
    const std::int64_t planes = s.n * s.c;
    float* memory = static_cast<float*>(static_cast<void*>(call.scratch.data()));
    float* spare = memory;
    memory += planes * s.plane();
    const std::vector<Level> levels = pull(inputs, memory);
    push(levels, planes, s.c, static_cast<const PushPullFillOp&>(op).sweeps(), f32(output), spare);
  }

 private:
  static std::vector<Level> pull(std::span<const Tensor> inputs, float* memory) {
    const Nchw s = nchw(inputs[0].shape());
    const std::int64_t planes = s.n * s.c;
    const std::vector<Extent> sizes = level_sizes(s);
    std::vector<Level> levels{{sizes[0], f32(inputs[0]), f32(inputs[1])}};
    for (std::size_t l = 1; l < sizes.size(); ++l) {
      float* x = memory;
      float* weight = x + planes * sizes[l].count();
      memory = weight + s.n * sizes[l].count();
      const Level fine = levels.back();
      for_rows(planes, sizes[l].h, [&](std::int64_t p, std::int64_t i) {
        pull_row(fine.x + p * fine.size.count(), fine.weight + p / s.c * fine.size.count(), fine.size,
                 x + p * sizes[l].count(), p % s.c == 0 ? weight + p / s.c * sizes[l].count() : nullptr,
                 sizes[l], i);
      });
      levels.push_back({sizes[l], x, weight});
    }
    return levels;
  }

  /// The two buffers take turns; the first turn is chosen so that the last one is the output's.
  static void push(const std::vector<Level>& levels, std::int64_t planes, std::int64_t channels, int sweeps,
                   float* output, float* spare) {
    const std::int64_t turns = static_cast<std::int64_t>(levels.size() - 1) * (sweeps + 1);
    float* now = turns % 2 == 0 ? output : spare;
    float* next = turns % 2 == 0 ? spare : output;
    std::memcpy(now, levels.back().x, static_cast<std::size_t>(planes) * sizeof(float));
    for (std::size_t l = levels.size() - 1; l-- > 0;) {
      const Level& level = levels[l];
      const Extent size = level.size;
      const Extent coarse = levels[l + 1].size;
      std::vector<Tap> columns;
      for (std::int64_t j = 0; j < size.w; ++j) columns.push_back(tap(j, coarse.w, size.w));
      for (int k = -1; k < sweeps; ++k) {
        for_rows(planes, size.h, [&](std::int64_t p, std::int64_t i) {
          const float* x = level.x + p * size.count();
          const float* weight = level.weight + p / channels * size.count();
          float* y = next + p * size.count();
          if (k < 0)
            blend_row(x, weight, now + p * coarse.count(), coarse, size, columns, i, y);
          else
            relax_row(x, weight, now + p * size.count(), size, i, y);
        });
        std::swap(now, next);
      }
    }
  }
};

const PushPullKernel kPushPull;
const Kernel* const kKernels[] = {&kPushPull};

}  // namespace

std::span<const Kernel* const> PushPullFillOp::kernels() const { return kKernels; }

}  // namespace slide::ops
