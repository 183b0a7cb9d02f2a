#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "runtime/error.h"
#include "runtime/shape.h"

namespace slide::ops {

/// What every operator's shape inference needs. All throw Error(kInternal); Graph::add() puts the layer's
/// name in front.

/// "conv2d needs 2 inputs, got 3"
void require_input_count(std::string_view op, std::span<const Shape> inputs, std::size_t least,
                         std::size_t most);

/// "the weight has shape 3x4, a tensor of rank 4 is needed"
void require_rank(std::string_view what, const Shape& shape, int rank);

/// "the bias has shape 5, 4 is needed"
void require_shape(std::string_view what, const Shape& shape, const Shape& wanted);

/// "the stride is 0, at least 1 is needed"
void require_at_least(std::string_view what, std::int64_t value, std::int64_t least);

/// The axis as an index in [0, rank); a negative axis counts from the end.
[[nodiscard]] int require_axis(std::string_view op, int axis, const Shape& shape);

/// Error(kInternal) with that text, for what the functions above do not cover.
[[nodiscard]] Error shape_error(const std::string& text);

}  // namespace slide::ops
