#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "runtime/tensor.h"

namespace slide::ops {

/// A tensor of ONNX's (TensorProto of https://github.com/onnx/onnx/blob/main/onnx/onnx.proto).
struct OnnxTensor {
  std::string name;
  Tensor values;  ///< F32, F64 or I64; of a tensor without elements shape 0
};

struct OnnxAttribute {
  double number = 0;         ///< of a float
  std::int64_t integer = 0;  ///< of an int
  std::string text;          ///< of a string
  std::vector<std::int64_t> integers;
};

/// A model of one node, as ONNX's node tests have it.
struct OnnxNode {
  std::string op;                   ///< "Conv"
  std::vector<std::string> inputs;  ///< names; an empty one is an input left out
  std::map<std::string, OnnxAttribute, std::less<>> attributes;
  std::vector<OnnxTensor> constants;  ///< the graph's initializers
};

/// Both throw Error(kBadInput) naming the file if the bytes are damaged, a tensor has more than five axes,
/// other elements than float, double and int64, or data that do not fit its shape; or a model has not one
/// node.
[[nodiscard]] OnnxTensor parse_onnx_tensor(std::span<const std::byte> bytes, const std::string& file);
[[nodiscard]] OnnxNode parse_onnx_node(std::span<const std::byte> model, const std::string& file);

/// All of a file of up to 64 MiB. Throws Error(kBadInput) naming it if it is larger or cannot be read.
[[nodiscard]] std::vector<std::byte> read_small_file(const std::string& path);

}  // namespace slide::ops
