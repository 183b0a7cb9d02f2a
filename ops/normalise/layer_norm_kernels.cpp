// Three passes over a line: its sum, the squares around its mean, the result. Columns go through vectors
// across the lines. The mean is split into its float32 and a rest, which joins after the difference, so that
// what rounding the mean loses is not lost.

#include "ops/normalise/layer_norm_routines.h"
#include "ops/simd/partial.h"
#include "ops/simd/simd.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;
using simd::load_some;
using simd::store_some;
typedef double Doubles __attribute__((vector_size(kWidth * 8)));

/// y = ((x - mean)·inverse + rest)·weight + bias.
struct Line {
  float mean, inverse, rest;
  double exact_mean, exact_inverse;
  bool wide;  ///< float32 does not hold the scale, or a difference could overflow or be denormal: all in
              ///< float64
};

Line line_of(double mean, double squares, std::int64_t count, double eps) {
  const double inverse = 1 / __builtin_sqrt(squares / static_cast<double>(count) + eps);
  const auto near = static_cast<float>(mean);
  const double far = __builtin_fabs(mean);
  const bool holds =
      far < 0x1p102 && (far >= 0x1p-102 || far == 0) && inverse >= 0x1p-100 && inverse < 0x1p100;
  return {near,
          static_cast<float>(inverse),
          static_cast<float>((static_cast<double>(near) - mean) * inverse),
          mean,
          inverse,
          !holds};
}

Float finished(Float x, Float mean, Float inverse, Float rest, Float weight, Float bias) {
  return fma(fma(x - mean, inverse, rest), weight, bias);
}

void finish_wide(const LayerNormLines& lines, const Line& line, const float* x, float* y) {
  for (std::int64_t i = 0; i < lines.count; ++i) {
    const double t = (static_cast<double>(x[i * lines.step]) - line.exact_mean) * line.exact_inverse;
    y[i * lines.step] =
        static_cast<float>(t * static_cast<double>(lines.weight[i]) + static_cast<double>(lines.bias[i]));
  }
}

/// The sum over a line of neighbours: of x - shift, or of its squares.
template <bool kSquares>
double sum_of_row(const float* x, std::int64_t count, double shift) {
  Doubles lanes{};
  std::int64_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    const Doubles d = __builtin_convertvector(simd::load(x + i).v, Doubles) - shift;
    lanes += kSquares ? d * d : d;
  }
  double sum = 0;
  for (int l = 0; l < kWidth; ++l) sum += lanes[l];
  for (; i < count; ++i) {
    const double d = static_cast<double>(x[i]) - shift;
    sum += kSquares ? d * d : d;
  }
  return sum;
}

void row(const LayerNormLines& lines, float* y) {
  const std::int64_t n = lines.count;
  const double mean = sum_of_row<false>(lines.x, n, 0) / static_cast<double>(n);
  const double squares = sum_of_row<true>(lines.x, n, mean);
  const Line line = line_of(mean, squares, n, lines.eps);
  if (line.wide) return finish_wide(lines, line, lines.x, y);
  for (std::int64_t i = 0; i < n; i += kWidth)
    store_some(
        y + i,
        finished(load_some(lines.x + i, n - i), broadcast(line.mean), broadcast(line.inverse),
                 broadcast(line.rest), load_some(lines.weight + i, n - i), load_some(lines.bias + i, n - i)),
        n - i);
}

/// `width` <= kWidth lines.
void column(const LayerNormLines& lines, const float* x, float* y, std::int64_t width) {
  const std::int64_t n = lines.count;
  Doubles sum{};
  for (std::int64_t i = 0; i < n; ++i)
    sum += __builtin_convertvector(load_some(x + i * lines.step, width).v, Doubles);
  const Doubles mean = sum / static_cast<double>(n);
  Doubles squares{};
  for (std::int64_t i = 0; i < n; ++i) {
    const Doubles d = __builtin_convertvector(load_some(x + i * lines.step, width).v, Doubles) - mean;
    squares += d * d;
  }
  Line all[kWidth];
  float means[kWidth];
  float inverses[kWidth];
  float rests[kWidth];
  bool wide = false;
  for (int l = 0; l < kWidth; ++l) {
    all[l] = line_of(mean[l], squares[l], n, lines.eps);
    means[l] = all[l].mean;
    inverses[l] = all[l].inverse;
    rests[l] = all[l].rest;
    wide = wide || (l < width && all[l].wide);
  }
  if (wide) {
    for (std::int64_t l = 0; l < width; ++l) finish_wide(lines, all[l], x + l, y + l);
    return;
  }
  for (std::int64_t i = 0; i < n; ++i)
    store_some(y + i * lines.step,
               finished(load_some(x + i * lines.step, width), simd::load(means), simd::load(inverses),
                        simd::load(rests), broadcast(lines.weight[i]), broadcast(lines.bias[i])),
               width);
}

void columns(const LayerNormLines& lines, float* y, std::int64_t columns) {
  for (std::int64_t j = 0; j < columns; j += kWidth)
    column(lines, lines.x + j, y + j, columns - j < kWidth ? columns - j : kWidth);
}

}  // namespace

extern const LayerNormRoutines layer_norm_loops;
const LayerNormRoutines layer_norm_loops{Isa::SLIDE_ISA_ENUM, row, columns};

}  // namespace slide::ops::SLIDE_ISA
