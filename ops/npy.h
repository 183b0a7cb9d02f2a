#pragma once

#include <string>

#include "runtime/tensor.h"

namespace slide::ops {

/// Reads an array as numpy.save() writes it (format 1 to 3: https://numpy.org/doc/stable/reference/
/// generated/numpy.lib.format.html): little-endian float16, float32 or float64 in C order, rank 0 to 5.
/// Throws Error(kBadInput) naming the file and what is wrong otherwise, with what to do in NumPy.
[[nodiscard]] Tensor read_npy(const std::string& path);

}  // namespace slide::ops
