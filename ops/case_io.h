#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/tensor.h"

namespace slide::ops {

/// One call of one operator with the result it should give, as it lies in a safetensors file: the inputs by
/// the operator's input names and the tensor "expected"; metadata "op", "attributes" (a JSON object) and
/// "source" (where the numbers come from). Tensors "actual", somebody's result, and "scale", what rounding
/// errors are proportional to, are no inputs. The table of operators is in docs/operators.md.
struct OperatorCase {
  std::string op;
  std::string attributes = "{}";
  std::string source;
  std::vector<std::pair<std::string, Tensor>> inputs;  ///< of any element type, in the file's order
  Tensor expected;                                     ///< F64 or F32
  Tensor scale = {};  ///< Op::error_scale() for readers without a definition: written if given, never read
};

/// Reads a case; the tensors are views of the mapped file. A file model.onnx, or a folder that holds one, is
/// read as one of ONNX's node tests (ops/onnx/onnx_case.h), "OPERATOR.json#3" as the third test of a WebNN file
/// (ops/webnn/webnn_case.h), which may hold only one if none is named. Throws Error(kBadInput) naming the file if it is
/// not a sound safetensors file, has no metadata "op", no tensor "expected", or one that is not F64 or F32.
[[nodiscard]] OperatorCase read_case(const std::string& path);

/// The tensor of that name in a safetensors file, or the only one that it holds; nothing if there are
/// several others. Throws Error(kBadInput) naming the file if it is not a sound safetensors file.
[[nodiscard]] std::optional<Tensor> tensor_in(const std::string& path, std::string_view name);

/// Writes a case so that read_case() gives the same back. Throws Error(kBadInput) if the file cannot be
/// written.
void write_case(const std::string& path, const OperatorCase& operator_case);

/// The cases that a path stands for: itself, of a WebNN file every test, or if it is a folder, every
/// *.safetensors, model.onnx and test of a WebNN file in it and below, sorted. Throws Error(kBadInput) if there is no such file or the folder holds none.
[[nodiscard]] std::vector<std::string> case_files(const std::string& path);

}  // namespace slide::ops
