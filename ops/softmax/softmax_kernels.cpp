// Three passes over the numbers: the largest; the exponentials and their sum in float64; the division. Rows
// go through vectors along the row, columns through vectors across the columns, with largest and sum of each
// column in small arrays.

#include "ops/simd/math.h"
#include "ops/softmax/softmax_routines.h"

namespace slide::ops::SLIDE_ISA {
namespace {

using simd::broadcast;
using simd::Float;
using simd::kWidth;
typedef double Doubles __attribute__((vector_size(kWidth * 8)));

void row(const float* x, float* y, std::size_t count) {
  float largest = x[0];
  for (std::size_t i = 1; i < count; ++i) largest = largest < x[i] ? x[i] : largest;
  const Float top = broadcast<>(largest);
  Doubles lanes{};
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth) {
    const Float e = simd::exp(simd::load(x + i) - top);
    simd::store(y + i, e);
    lanes += __builtin_convertvector(e.v, Doubles);
  }
  double sum = 0;
  for (int l = 0; l < kWidth; ++l) sum += lanes[l];
  if (i < count) {
    simd::store_partial(y + i, simd::exp(simd::load_partial(x + i, count - i) - top), count - i);
    for (std::size_t k = i; k < count; ++k) sum += static_cast<double>(y[k]);
  }
  const Float divisor = broadcast<>(static_cast<float>(sum));
  for (i = 0; i + kWidth <= count; i += kWidth) simd::store(y + i, simd::load(y + i) / divisor);
  if (i < count) simd::store_partial(y + i, simd::load_partial(y + i, count - i) / divisor, count - i);
}

void exp_of_difference(const float* x, const float* largest, float* y, std::size_t count) {
  std::size_t i = 0;
  for (; i + kWidth <= count; i += kWidth)
    simd::store(y + i, simd::exp(simd::load(x + i) - simd::load(largest + i)));
  if (i < count) {
    const Float d = simd::load_partial(x + i, count - i) - simd::load_partial(largest + i, count - i);
    simd::store_partial(y + i, simd::exp(d), count - i);
  }
}

void columns(const float* x, float* y, std::size_t count, std::size_t step, std::size_t columns) {
  float largest[SoftmaxRoutines::kColumns];
  float divisor[SoftmaxRoutines::kColumns];
  double sum[SoftmaxRoutines::kColumns];
  for (std::size_t j = 0; j < columns; ++j) {
    largest[j] = x[j];
    sum[j] = 0;
  }
  for (std::size_t i = 1; i < count; ++i)
    for (std::size_t j = 0; j < columns; ++j) {
      const float v = x[i * step + j];
      largest[j] = largest[j] < v ? v : largest[j];
    }
  for (std::size_t i = 0; i < count; ++i) {
    exp_of_difference(x + i * step, largest, y + i * step, columns);
    for (std::size_t j = 0; j < columns; ++j) sum[j] += static_cast<double>(y[i * step + j]);
  }
  for (std::size_t j = 0; j < columns; ++j) divisor[j] = static_cast<float>(sum[j]);
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < columns; ++j) y[i * step + j] /= divisor[j];
}

}  // namespace

extern const SoftmaxRoutines softmax_loops;
const SoftmaxRoutines softmax_loops{Isa::SLIDE_ISA_ENUM, row, columns};

}  // namespace slide::ops::SLIDE_ISA
