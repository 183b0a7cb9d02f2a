#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "ops/case_io.h"

namespace slide::ops {

/// What somebody else's operator multiplies with. Sums are taken to be in float32 (int8: exact).
enum class Unit { kFp32, kTf32, kBf16, kFp16, kInt8 };

/// "fp32", "tf32", "bf16", "fp16", "int8".
[[nodiscard]] std::optional<Unit> unit_from_name(std::string_view name);

/// What a case's result should be: the float64 definition on the inputs, and for every element what rounding
/// errors are proportional to (Op::error_scale(); where a case is several nodes, the errors of the first ones
/// are carried to the result by finite differences).
struct CaseValues {
  Tensor y64;        ///< F64
  Tensor scale;      ///< F64
  Tensor textbook;   ///< F64: the same for a program that evaluates formulas as they stand (textbook_scale.h)
  double terms = 1;  ///< products summed up for an element, one if it is no sum
  double factor = 1;  ///< the largest that a float32 kernel of this build states for the call
};

/// How many unit roundoffs of the scale a right float32 result may be off: products, sums and three more
/// roundings cover the kernels of every processor, so that all judge alike; (1 + u)^n - 1 <= 1.001·n·u for
/// n < 2^14.
[[nodiscard]] double float_factor(const CaseValues& values);

/// With `rounded`, inputs are rounded to float32 first, as an operator in float32 gets them. Throws
/// Error(kBadInput) as build_case() does.
[[nodiscard]] CaseValues values_of(const OperatorCase& operator_case, bool rounded);

/// One element that is over its bound.
struct WrongElement {
  std::vector<std::int64_t> index;
  double actual = 0, expected = 0, bound = 0;
};

/// How a result fares against a case, element by element:
///     |actual - y64| <= factor · u · scale + max(factor, 1) · 2^-126,
/// and as a whole, by its rms error. Where terms of both signs go beyond float32's range, NaN and infinity pass.
struct Judgement {
  std::string problem;  ///< why nothing could be compared: the shapes; else empty
  std::int64_t elements = 0, wrong = 0;
  double factor = 0;        ///< the one used
  double of_bound = 0;      ///< the largest quotient of both sides
  double rms = 0;           ///< of actual - y64, relative to that of y64, over finite elements
  double expected_rms = 0;  ///< what roundings that are independent of each other would make of it
  double rms_limit = 0;     ///< what `rms` may be: see kRmsAllowance
  std::optional<WrongElement> first, worst;
  std::vector<std::string> patterns;  ///< what the wrong elements have in common, one clause each

  [[nodiscard]] bool passed() const noexcept { return problem.empty() && wrong == 0 && rms <= rms_limit; }
};

/// An rms error may be this times what independent roundings would make. The bound of an element, which
/// allows for the worst case, does not see a constant that is wrong in its fifth digit; the rms error does.
/// If errors larger than the default's are asked for (`factor`), it is allowed to grow alike.
inline constexpr double kRmsAllowance = 16;

/// @param factor  c of the bound; by default what the unit's rounding of inputs and result (3) and the sum of
///                the operator's terms in float32, in any order, may cost
/// Throws Error(kBadInput) as values_of() does, and if `actual` holds no floating-point numbers.
[[nodiscard]] Judgement judge(const OperatorCase& operator_case, const Tensor& actual, Unit unit,
                              std::optional<double> factor = std::nullopt);

/// At most a dozen lines.
[[nodiscard]] std::string text_of(const Judgement& judgement);

}  // namespace slide::ops
