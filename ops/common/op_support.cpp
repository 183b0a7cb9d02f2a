#include "ops/common/op_support.h"

namespace slide::ops {

Error shape_error(const std::string& text) { return Error(ErrorKind::kInternal, text); }

void require_input_count(std::string_view op, std::span<const Shape> inputs, std::size_t least,
                         std::size_t most) {
  if (inputs.size() >= least && inputs.size() <= most) return;
  const std::string wanted =
      least == most ? std::to_string(least) : std::to_string(least) + " to " + std::to_string(most);
  throw shape_error(std::string(op) + " needs " + wanted + " inputs, got " + std::to_string(inputs.size()));
}

void require_rank(std::string_view what, const Shape& shape, int rank) {
  if (shape.rank() != rank)
    throw shape_error("the " + std::string(what) + " has shape " + shape.text() + ", a tensor of rank " +
                      std::to_string(rank) + " is needed");
}

void require_shape(std::string_view what, const Shape& shape, const Shape& wanted) {
  if (shape != wanted)
    throw shape_error("the " + std::string(what) + " has shape " + shape.text() + ", " + wanted.text() +
                      " is needed");
}

void require_at_least(std::string_view what, std::int64_t value, std::int64_t least) {
  if (value < least)
    throw shape_error("the " + std::string(what) + " is " + std::to_string(value) + ", at least " +
                      std::to_string(least) + " is needed");
}

int require_axis(std::string_view op, int axis, const Shape& shape) {
  const int index = axis < 0 ? axis + shape.rank() : axis;
  if (index < 0 || index >= shape.rank())
    throw shape_error(std::string(op) + ": axis " + std::to_string(axis) + " of a tensor of shape " +
                      shape.text());
  return index;
}

}  // namespace slide::ops
