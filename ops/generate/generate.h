#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "ops/case_io.h"

namespace slide::ops {

/// What the numbers of a generated case are meant to find out.
enum class Trial {
  kRandom,      ///< normally distributed: the usual
  kIntegers,    ///< small whole numbers: results that are exact, and ties
  kConstant,    ///< all elements equal: no variance, everything a tie
  kLargeMean,   ///< 10,000 and a little: what a mean that is subtracted too late loses
  kCancelling,  ///< neighbours of opposite sign that nearly cancel: what partial sums lose
  kSpecials,    ///< a NaN and both infinities among the usual
  kDenormal,    ///< about float32's smallest
  kRange,       ///< magnitudes from end to end of what keeps the operator's sums within float32
};
inline constexpr int kTrials = 8;

/// "random", "large_mean" ...
[[nodiscard]] std::string_view name_of(Trial trial);

/// A call that operators may be wrong on, with its answer: attributes and shapes as draft_call() draws them,
/// inputs in float32, `expected` and `scale` the float64 definition's. The index goes through the trials in
/// turn; operators that are defined for moderate finite numbers only (see CallDraft::bounded) get the usual
/// numbers instead of kSpecials and kRange. Inputs are denormal only where it does not matter that an
/// operator takes them for zero. Depends on operator, seed and index alone. Throws Error(kUsage) if there is
/// no operator of that name.
[[nodiscard]] OperatorCase generate_case(std::string_view op, std::uint64_t seed, std::uint64_t index);

/// The trial of that case.
[[nodiscard]] Trial trial_of(std::uint64_t index);

/// Writes cases 0 to count - 1 of an operator, or of every one ("all"), to a folder, which is made if need
/// be: conv2d_1_0004_cancelling.safetensors for seed 1 and index 4. Returns how many. Throws, before anything
/// is written, Error(kUsage) if there is no operator of that name or, unless `overwrite`, if a file that
/// would be replaced is not one that this function has written; Error(kOutput) if a file cannot be written.
std::size_t generate_files(std::string_view op, std::uint64_t seed, int count, const std::string& folder,
                           bool overwrite);

}  // namespace slide::ops
