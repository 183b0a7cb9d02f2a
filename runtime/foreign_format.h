#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

namespace slide {

/// What people give as weights that are none.
struct ForeignFormat {
  std::string_view name;    ///< with its article: "a web page"
  std::string_view remedy;  ///< what to do, one clause
};

/// Tells by a file's first bytes (512 are enough) what it is, if it is a well-known kind of file that holds
/// no safetensors: a web page saved under another name, a Git LFS pointer, a tar or gzip archive, ONNX, HDF5,
/// GGUF, TensorFlow Lite, or a PyTorch checkpoint.
[[nodiscard]] std::optional<ForeignFormat> foreign_format(std::span<const std::byte> start);

}  // namespace slide
