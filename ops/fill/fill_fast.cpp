// Push-pull in float32. The pull pyramid of weights and weighted means is built once, level by level. The
// push goes level by level, too: a task makes a band of rows, from the level below and through all sweeps, in
// two buffers of its own; what the sweeps read around it is computed by the neighbours' tasks, too. Each
// element is computed the same way whatever the task.

#include <algorithm>
#include <array>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/fill/fill_op.h"
#include "ops/fill/fill_routines.h"
#include "ops/resize/resized_rows.h"
#include "ops/simd/dispatch.h"
#include "runtime/threads.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator) \
  namespace level {                      \
  extern const FillRoutines filling;     \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const FillRoutines* const> fill_routines() {
#define SLIDE_LIST(level, enumerator) &level::filling,
  static constexpr const FillRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

constexpr std::int64_t kRowGrain = 16;  // rows per task of the pull
constexpr std::int64_t kBandRows = 32;  // per task of the push, at least

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

/// One level of the pyramid: planes of values, `channels` of which share one of weights.
struct Level {
  Extent size;
  const float* x;
  const float* weight;
};

/// Of a band: several times the rows around it that are computed twice.
std::int64_t band_rows(int sweeps) { return std::max<std::int64_t>(kBandRows, 4 * sweeps); }

/// Two buffers of a band and what its sweeps read around it.
std::int64_t band_size(std::int64_t width, int sweeps) {
  return 2 * (band_rows(sweeps) + 2 * sweeps) * width;
}

/// The rows first <= i < last of one plane of the push.
class Band {
 public:
  Band(const FillRoutines& routines, const float* x, const float* weight, Extent size, int sweeps)
      : routines_(routines), x_(x), weight_(weight), size_(size), sweeps_(sweeps) {}

  void make(ResizedRows& below, std::int64_t first, std::int64_t last, float* buffers, float* y) const {
    const std::int64_t base = std::max<std::int64_t>(0, first - sweeps_);  // row of the buffers' start
    float* now = buffers;
    float* next = buffers + band_size(size_.w, sweeps_) / 2;
    for (int step = 0; step <= sweeps_; ++step) {
      const std::int64_t around = sweeps_ - step;  // rows that the sweeps to come read
      const std::int64_t end = std::min(size_.h, last + around);
      for (std::int64_t i = std::max<std::int64_t>(0, first - around); i < end; ++i) {
        float* to = step == sweeps_ ? y + i * size_.w : next + (i - base) * size_.w;
        if (step == 0)
          blend(below, i, to);
        else
          relax(now, base, i, to);
      }
      std::swap(now, next);
    }
  }

 private:
  void blend(ResizedRows& below, std::int64_t i, float* y) const {
    below.write(i, y);
    routines_.blend(x_ + i * size_.w, weight_ + i * size_.w, y, y, size_.w);
  }
  void relax(const float* before, std::int64_t base, std::int64_t i, float* y) const {
    const auto row = [&](std::int64_t r) {
      return before + (std::clamp<std::int64_t>(r, 0, size_.h - 1) - base) * size_.w;
    };
    routines_.relax(x_ + i * size_.w, weight_ + i * size_.w, {row(i - 1), row(i), row(i + 1)}, y, size_.w);
  }

  const FillRoutines& routines_;
  const float* x_;
  const float* weight_;
  Extent size_;
  int sweeps_;
};

class PushPullKernel : public LevelKernel<PushPullFillOp, FillRoutines> {
 public:
  PushPullKernel(std::string_view name, const FillRoutines& routines)
      : LevelKernel(name, routines), resize_(resize_routines(routines.isa)) {}

  /// The pyramid, the results of two levels, and a band for each thread.
  [[nodiscard]] std::size_t scratch_bytes(const Op& op, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    const Nchw s = nchw(inputs[0]);
    const int sweeps = static_cast<const PushPullFillOp&>(op).sweeps();
    std::int64_t floats = thread_count() * band_size(s.w, sweeps);
    const std::vector<Extent> sizes = level_sizes(s);
    for (std::size_t l = 1; l < sizes.size(); ++l)
      floats += (s.n * s.c + s.n + (l <= 2 ? s.n * s.c : 0)) * sizes[l].count();
    return static_cast<std::size_t>(floats) * sizeof(float);
  }

 private:
  /// A level's weights carry at most 6 roundings more than the last one's (3 along each side), its means
  /// 2·6·level + 14 through them, the blend and its sweeps 2·6·level together, as a sweep leaves 1 - w of
  /// what was wrong before; the enlargement adds 8, the blend 4, each sweep 8. All else averages, which does
  /// not grow errors.
  [[nodiscard]] double factor(const PushPullFillOp& op, std::span<const Shape> inputs) const override {
    const auto levels = static_cast<double>(level_sizes(nchw(inputs[0])).size());
    return rounding_factor(levels * (12 * levels + 26 + 8 * static_cast<double>(op.sweeps())));
  }

  void compute(const PushPullFillOp& op, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    const Nchw s = nchw(inputs[0].shape());
    const std::int64_t planes = s.n * s.c;
    const std::vector<Extent> sizes = level_sizes(s);
    std::span memory(static_cast<float*>(static_cast<void*>(scratch.data())), scratch.size() / sizeof(float));
    const auto take = [&](std::int64_t count) {
      float* const taken = memory.data();
      memory = memory.subspan(static_cast<std::size_t>(count));
      return taken;
    };
    std::vector<Level> levels{{sizes[0], f32(inputs[0]), f32(inputs[1])}};
    for (std::size_t l = 1; l < sizes.size(); ++l) {
      float* x = take(planes * sizes[l].count());
      float* weight = take(s.n * sizes[l].count());
      pull(levels.back(), s, sizes[l], x, weight);
      levels.push_back({sizes[l], x, weight});
    }
    std::array<float*, 3> results{f32(output), nullptr, nullptr};  // of levels 0, 1 3 5 ... and 2 4 6 ...
    for (std::size_t l = 1; l < std::min(results.size(), levels.size()); ++l)
      results[l] = take(planes * sizes[l].count());
    const float* below = levels.back().x;
    if (levels.size() == 1) std::copy_n(below, planes, f32(output));
    for (std::size_t l = levels.size() - 1; l-- > 0;) {
      float* y = results[l == 0 ? 0 : 2 - l % 2];
      push(levels[l], s, below, levels[l + 1].size, op.sweeps(), memory, y);
      below = y;
    }
  }

  void pull(const Level& fine, const Nchw& s, Extent coarse, float* x, float* weight) const {
    for_ranges(s.n * s.c * coarse.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t r = begin; r < end; ++r) {
        const std::int64_t plane = r / coarse.h;
        const std::int64_t i = r % coarse.h;
        const std::int64_t image = plane / s.c;
        PullRows rows{{}, {}, {}, fine.size.w};
        for (std::size_t u = 0; u < 4; ++u) {
          const std::int64_t row = 2 * i - 1 + static_cast<std::int64_t>(u);
          const std::int64_t at = std::clamp<std::int64_t>(row, 0, fine.size.h - 1) * fine.size.w;
          rows.inside[u] = row >= 0 && row < fine.size.h ? 1.0F : 0.0F;
          rows.x[u] = fine.x + plane * fine.size.count() + at;
          rows.weight[u] = fine.weight + image * fine.size.count() + at;
        }
        routines().pull(rows, coarse.w, x + r * coarse.w,
                        plane % s.c == 0 ? weight + (image * coarse.h + i) * coarse.w : nullptr);
      }
    });
  }

  void push(const Level& level, const Nchw& s, const float* below, Extent coarse, int sweeps,
            std::span<float> memory, float* y) const {
    const Extent size = level.size;
    const std::int64_t rows = band_rows(sweeps);
    const std::int64_t bands = (size.h + rows - 1) / rows;
    const std::int64_t buffers = band_size(s.w, sweeps);
    const std::int64_t slots = std::ssize(memory) / buffers;
    ResizeParams enlargement;
    enlargement.size = {size.h, size.w};
    const ResizeTables tables(ResizeOp(enlargement), coarse.h, coarse.w);
    parallel_for(s.n * s.c * bands, slots, [&](std::int64_t task, std::int64_t slot) {
      const std::int64_t plane = task / bands;
      const std::int64_t first = task % bands * rows;
      ResizedRows enlarged(resize_, tables, below + plane * coarse.count());
      Band(routines(), level.x + plane * size.count(), level.weight + plane / s.c * size.count(), size,
           sweeps)
          .make(enlarged, first, std::min(size.h, first + rows), memory.data() + slot * buffers,
                y + plane * size.count());
    });
  }

  const ResizeRoutines& resize_;
};

}  // namespace

std::span<const Kernel* const> PushPullFillOp::kernels() const {
  static const KernelList<PushPullKernel, FillRoutines> list("push_pull_fill.bands", fill_routines());
  return list.all();
}

}  // namespace slide::ops
