#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "ops/case_io.h"

namespace slide::ops {

// Conformance tests of W3C's Web Neural Network API as web-platform-tests keeps them: JSON files
// webnn/resources/test_data/OPERATOR.json of many tests each, {"tests": [{"name", "inputs", "options",
// "expected"}, ...]}, with comments. The file's name is the operator.
//
// Read are conv2d, average_pool2d, max_pool2d, resample2d, batch_normalization, clamp, concat, softmax, pad,
// reduce_mean, reduce_min and reduce_max (dimensions kept), abs, exp, sqrt, relu, sigmoid, tanh, gelu, elu,
// leaky_relu, linear, add, sub, mul, div, max and min, of float32 tensors; images in both layouts, nchw and
// nhwc, filters in all four.

/// The tests of a file; nothing if it is no JSON object with a list "tests". Throws Error(kBadInput) naming the
/// file if it cannot be read or is larger than 64 MiB.
[[nodiscard]] std::optional<std::size_t> webnn_tests(const std::string& file);

/// Reads test `index` (the first is 1) of a file as an operator case; images in nhwc become nchw. Throws
/// Error(kBadInput) naming file and test if there is no such test, it is damaged, or its operator, type or
/// options are none of these.
[[nodiscard]] OperatorCase read_webnn_case(const std::string& file, std::size_t index);

/// The same of a file's bytes. `file`: what messages call it.
[[nodiscard]] OperatorCase parse_webnn_case(std::span<const std::byte> json, std::string_view op,
                                            std::size_t index, const std::string& file);

}  // namespace slide::ops
