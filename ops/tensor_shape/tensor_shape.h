#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "runtime/graph.h"

namespace slide::ops {

/// Joins tensors along an axis (negative: from the end); all other extents must be equal. At least one input.
Value concat(const std::vector<Value>& inputs, int axis);

/// The elements start <= index < end of one axis (negative: from the end).
/// Throws Error(kInternal) unless 0 <= start < end <= extent.
Value slice(Value x, int axis, std::int64_t start, std::int64_t end);

enum class PadMode {
  kConstant,  ///< a given value
  kEdge,      ///< the border element repeated
  kReflect,   ///< mirrored about the border element, which is not repeated; padding < extent
};

/// Pads the last two axes of N×C×H×W; padding is top, left, bottom, right, each >= 0.
Value pad(Value x, const std::array<std::int64_t, 4>& padding, PadMode mode, double value = 0);

/// The same elements in row-major order under another shape of equal count.
Value reshape(Value x, const Shape& shape);

/// The axes in another order: axis k of the result is axis axes[k] of x, as torch.permute. `axes` names each
/// axis of x once, from 0.
Value permute(Value x, const std::vector<int>& axes);

}  // namespace slide::ops
