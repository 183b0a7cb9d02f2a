#pragma once

#include <string>

#include "ops/case_io.h"

namespace slide::ops {

/// Reads a node test of ONNX's (https://github.com/onnx/onnx/tree/main/onnx/backend/test) as an operator
/// case: model.onnx, and beside it test_data_set_0/input_0.pb ... and output_0.pb. Read are Conv, MaxPool,
/// AveragePool, GlobalAveragePool, Resize, Relu, Sigmoid, Tanh, Exp, Sqrt, Abs, Elu, LeakyRelu, Clip,
/// Softmax, Add, Sub, Mul, Div, Max and Min of two, Concat, BatchNormalization and Pad, in two dimensions
/// where there are images, float32 or float64.
/// @param model  the path of model.onnx
/// Throws Error(kBadInput) naming the file if it is damaged, or an operator or attribute that is none of
/// these.
[[nodiscard]] OperatorCase read_onnx_case(const std::string& model);

}  // namespace slide::ops
