#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "ops/generate/random.h"
#include "runtime/shape.h"

namespace slide::ops {

/// What an input of an operator means, which decides the numbers that it is tried with.
enum class Content {
  kSignal,  ///< any numbers
  /// Of a sum over all axes but the first: small enough that the result is of the size of x. Never constant:
  /// roundings of equal terms are equal, and nobody can predict what they add up to.
  kWeights,
  kParameter,  ///< biases and the like: about 1
  kPositive,   ///< variances
  kUnit,       ///< in [0, 1], often 0 and 1
  kPicture,    ///< in [0, 1]
};

struct CallDraftInput {
  std::string name;
  Shape shape;
  Content content;
};

/// A call without its numbers.
struct CallDraft {
  nlohmann::ordered_json attributes = nlohmann::ordered_json::object();
  std::vector<CallDraftInput> inputs;
  bool bounded = false;  ///< defined for finite numbers of moderate size only
  int most_reach = 120;  ///< magnitudes go from 2^-most_reach to 2^most_reach at most
};

/// Draws attributes and shapes for an operator that build_case() knows: extents of 1, about the vector widths
/// and about the tiles of matrix products, borders, strides, groups. A call takes some ten million
/// multiplications at most. Throws Error(kUsage) if there is no operator of that name.
[[nodiscard]] CallDraft draft_call(std::string_view op, Random& random);

}  // namespace slide::ops
