#pragma once

#include <string>

#include "ops/case_io.h"

namespace slide {

/// What the function slide_operator() of a shared library (c_api/slide_operator.h) makes of a case's inputs,
/// rounded to float32; F32, in the shape of the case's expected result. The library runs in this process.
/// Throws Error(kBadInput) naming the library if it cannot be loaded, has no such function, refuses the call
/// or writes outside of its result; Error(kUsage) where programs cannot load libraries (static builds).
[[nodiscard]] Tensor result_of_library(const std::string& path, const ops::OperatorCase& operator_case);

}  // namespace slide
