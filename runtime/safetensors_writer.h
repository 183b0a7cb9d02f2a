#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/atomic_file.h"
#include "runtime/safetensors.h"
#include "runtime/tensor.h"

namespace slide {

/// Writes a safetensors file piece by piece, so that only the piece at hand need be in memory. The data
/// section starts at a multiple of 64 bytes; in it tensors of larger elements come first, which aligns every
/// one; the header lists tensors in the order given. Checksums are added to the metadata (see Metadata). The
/// file appears under its name only at finish(), see AtomicFile for the errors.
class SafetensorsWriter {
 public:
  /// Throws Error(kInternal) if a name comes twice, holds control characters or is not UTF-8, or `metadata`
  /// holds checksum keys.
  SafetensorsWriter(const std::string& path, std::vector<TensorInfo> tensors, const Metadata& metadata);

  /// The next bytes of the tensors, one tensor after the other in the order given; a call must not go past
  /// the end of a tensor (Error(kInternal)).
  void write(std::span<const std::byte> bytes);

  /// Completes the file. Throws Error(kInternal) if a tensor is not complete.
  void finish();

  /// The name that the file has until finish(). Once its last tensor is complete it can be read there.
  [[nodiscard]] const std::string& temporary_path() const noexcept { return file_.temporary_path(); }

 private:
  void skip_complete();

  AtomicFile file_;
  std::vector<TensorInfo> tensors_;
  std::vector<std::uint64_t> offsets_;          // of each tensor's data, in the file
  std::vector<std::uint64_t> checksum_fields_;  // where each tensor's eight digits go, in the file
  std::size_t current_ = 0;
  std::size_t written_ = 0;  // bytes of the current tensor
  std::uint32_t crc_ = 0;    // of those bytes
};

/// Writes all tensors in one call.
void write_safetensors(const std::string& path, const std::vector<std::pair<std::string, Tensor>>& tensors,
                       const Metadata& metadata = {});

}  // namespace slide
