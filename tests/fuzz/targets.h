#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace slide::fuzz {

using Bytes = std::vector<std::uint8_t>;

/// One reader of what comes from outside.
struct Target {
  std::string name;
  /// Reads hostile bytes. Returns whether they were taken; an Error that refuses them is as good. Whatever
  /// else happens (another exception, a signal, a sanitizer's report) is a finding.
  std::function<bool(std::span<const std::uint8_t>)> read;
  std::vector<Bytes> seeds;  ///< good inputs, small
};

/// All targets: JPEG and PNG photos, maps (PFM, NumPy), what is read through OpenImageIO, EXIF, ICC profiles,
/// safetensors, checkpoints, operator cases, ONNX models and tensors, camera poses.
[[nodiscard]] std::vector<Target> targets();

}  // namespace slide::fuzz
