#include <algorithm>
#include <array>
#include <vector>

#include "ops/common/elements.h"
#include "ops/common/level_kernel.h"
#include "ops/matting/foreground_op.h"
#include "ops/matting/foreground_routines.h"
#include "ops/simd/dispatch.h"

namespace slide::ops {

#define SLIDE_DECLARE(level, enumerator)      \
  namespace level {                           \
  extern const ForegroundRoutines foreground; \
  }
SLIDE_EACH_ISA(SLIDE_DECLARE)
#undef SLIDE_DECLARE

std::span<const ForegroundRoutines* const> foreground_routines() {
#define SLIDE_LIST(level, enumerator) &level::foreground,
  static constexpr const ForegroundRoutines* kAll[] = {SLIDE_EACH_ISA(SLIDE_LIST)};
#undef SLIDE_LIST
  return kAll;
}

namespace {

constexpr std::int64_t kRowGrain = 16;

/// Planes of one size in memory: those of I and alpha, or of F and B.
template <typename T>
struct PlanesOf {
  T* data;
  std::int64_t h, w;
  [[nodiscard]] T* row(std::int64_t plane, std::int64_t i) const { return data + (plane * h + i) * w; }
  operator PlanesOf<const T>() const { return {data, h, w}; }  // NOLINT: as pointers convert
};
using Planes = PlanesOf<float>;
using ConstPlanes = PlanesOf<const float>;

/// `count` planes at another size, by nearest neighbour.
void pick(const ConstPlanes& from, std::int64_t count, const Planes& to) {
  for_ranges(count * to.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t r = begin; r < end; ++r) {
      const float* x = from.row(r / to.h, r % to.h * from.h / to.h);
      float* y = to.row(r / to.h, r % to.h);
      for (std::int64_t j = 0; j < to.w; ++j) y[j] = x[j * from.w / to.w];
    }
  });
}

/// The means that F and B of a channel start with; in float64, row by row.
std::array<float, 2> first_colours(const float* image, const float* alpha, const Nchw& s) {
  struct Sums {
    double front = 0, behind = 0, fronts = 0, behinds = 0;
  };
  std::vector<Sums> rows(static_cast<std::size_t>(s.h));
  for_ranges(s.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      Sums& sums = rows[static_cast<std::size_t>(i)];
      for (std::int64_t j = i * s.w; j < (i + 1) * s.w; ++j) {
        const bool front = static_cast<double>(alpha[j]) > kSurelyFront;
        const bool behind = static_cast<double>(alpha[j]) < kSurelyBehind;
        const auto colour = static_cast<double>(image[j]);
        sums.fronts += front ? 1 : 0;
        sums.behinds += behind ? 1 : 0;
        sums.front += front ? colour : 0;
        sums.behind += behind ? colour : 0;
      }
    }
  });
  Sums all;
  for (const Sums& row : rows) {
    all.front += row.front;
    all.behind += row.behind;
    all.fronts += row.fronts;
    all.behinds += row.behinds;
  }
  const auto mean = [](double sum, double count) { return static_cast<float>(count == 0 ? 0 : sum / count); };
  return {mean(all.front, all.fronts), mean(all.behind, all.behinds)};
}

/// Numbers of the colours' two buffers of a level and of its I and alpha. The last level is the picture's
/// own: its first buffer is the output, and I and alpha are the inputs.
struct LevelSize {
  std::int64_t colours, photo;
};
LevelSize level_size(const MattingLevel& level, std::int64_t channels) {
  return {2 * channels * level.h * level.w, (channels + 1) * level.h * level.w};
}

class ForegroundKernel : public LevelKernel<ForegroundColoursOp, ForegroundRoutines> {
 public:
  using LevelKernel::LevelKernel;

  /// The second buffer of the largest level, and two levels before it that take turns.
  [[nodiscard]] std::size_t scratch_bytes(const Op& /*op*/, std::span<const Shape> inputs,
                                          const Shape& /*output*/) const override {
    const Nchw s = nchw(inputs[0]);
    const std::vector<MattingLevel> levels = matting_levels(s.h, s.w);
    std::int64_t floats = level_size(levels.back(), s.c).colours;
    if (levels.size() > 1) {
      const LevelSize before = level_size(levels[levels.size() - 2], s.c);
      floats += 2 * before.colours + before.photo;
    }
    return static_cast<std::size_t>(floats + 2 * s.c) * sizeof(float);
  }

 private:
  /// A step maps the colours (F, B) of a pixel to a mean of the neighbours' and moves it to the line
  /// alpha·F + (1 - alpha)·B = I, partly: neither makes the Euclidean length of an error larger, so that only
  /// roundings of the steps themselves add up. Each weight carries 3, d 5, a mean 14 of at most √2 (both
  /// colours), the residual 4 and its factor 9, of at most 2 times √2, the sum 3: 60 a step, for I in [0, 1].
  [[nodiscard]] double factor(const ForegroundColoursOp& /*op*/,
                              std::span<const Shape> inputs) const override {
    const Nchw s = nchw(inputs[0]);
    double steps = 0;
    for (const MattingLevel& level : matting_levels(s.h, s.w)) steps += level.steps;
    return rounding_factor(60 * steps + 1);
  }

  void compute(const ForegroundColoursOp& /*op*/, std::span<const Tensor> inputs, Tensor& output,
               std::span<std::byte> scratch) const override {
    const Nchw s = nchw(inputs[0].shape());
    auto* memory = static_cast<float*>(static_cast<void*>(scratch.data()));
    for (std::int64_t n = 0; n < s.n; ++n)
      estimate(f32(inputs[0]) + n * s.c * s.plane(), f32(inputs[1]) + n * s.plane(), s, memory,
               f32(output) + 2 * n * s.c * s.plane());
  }

  void estimate(const float* image, const float* alpha, const Nchw& s, float* memory, float* output) const {
    const std::vector<MattingLevel> levels = matting_levels(s.h, s.w);
    Planes before{memory, 1, 1};
    for (std::int64_t c = 0; c < s.c; ++c) {
      const auto [front, behind] = first_colours(image + c * s.plane(), alpha, s);
      before.data[c] = front;
      before.data[s.c + c] = behind;
    }
    float* other = memory + 2 * s.c;
    float* const taking_turns = other + level_size(levels.back(), s.c).colours;
    const ConstPlanes photo{image, s.h, s.w};
    const ConstPlanes matte{alpha, s.h, s.w};
    for (std::size_t l = 0; l + 1 < levels.size(); ++l) {
      const MattingLevel& level = levels[l];
      const LevelSize most = level_size(levels[levels.size() - 2], s.c);
      const Planes x{taking_turns + static_cast<std::int64_t>(l % 2) * most.colours, level.h, level.w};
      const Planes small_photo{taking_turns + 2 * most.colours, level.h, level.w};
      const Planes small_matte{small_photo.row(s.c, 0), level.h, level.w};
      pick(photo, s.c, small_photo);
      pick(matte, 1, small_matte);
      pick(before, 2 * s.c, x);
      improve(x, small_photo, small_matte, s.c, level.steps, other);
      before = x;
    }
    const Planes result{output, s.h, s.w};
    pick(before, 2 * s.c, result);
    improve(result, photo, matte, s.c, levels.back().steps, other);
  }

  /// An even number of steps there and back between `x` and the buffer `other`.
  void improve(const Planes& x, const ConstPlanes& photo, const ConstPlanes& matte, std::int64_t channels,
               int steps, float* other) const {
    Planes from = x;
    Planes to{other, x.h, x.w};
    for (int step = 0; step < steps; ++step, std::swap(from, to))
      for_ranges(x.h, kRowGrain, [&](std::int64_t begin, std::int64_t end) {
        std::vector<ForegroundChannel> rows(static_cast<std::size_t>(channels));
        for (std::int64_t i = begin; i < end; ++i) {
          const auto around = [&](const ConstPlanes& p, std::int64_t plane) -> std::array<const float*, 3> {
            return {p.row(plane, std::max<std::int64_t>(0, i - 1)), p.row(plane, i),
                    p.row(plane, std::min(p.h - 1, i + 1))};
          };
          for (std::int64_t c = 0; c < channels; ++c)
            rows[static_cast<std::size_t>(c)] = {photo.row(c, i), around(from, c), around(from, channels + c),
                                                 to.row(c, i), to.row(channels + c, i)};
          routines().improve({around(matte, 0), x.w}, rows.data(), channels);
        }
      });
  }
};

}  // namespace

std::span<const Kernel* const> ForegroundColoursOp::kernels() const {
  static const KernelList<ForegroundKernel, ForegroundRoutines> list("foreground_colours.rows",
                                                                     foreground_routines());
  return list.all();
}

}  // namespace slide::ops
