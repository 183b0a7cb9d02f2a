#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/safetensors.h"

namespace slide {

/// The largest header that is read, as in the reference implementation of the format.
inline constexpr std::uint64_t kMaxSafetensorsHeader = 100'000'000;

/// What the header of a safetensors file says, checked against the size of the data.
struct SafetensorsHeader {
  struct Entry {
    TensorInfo info;
    std::uint64_t begin = 0;  ///< within the data
    std::uint64_t end = 0;
  };
  std::vector<Entry> entries;  ///< in the order of the header
  Metadata metadata;
};

/// Parses and checks a header. `text` is the JSON, which starts at byte 8 of the file. Throws
/// Error(kBadWeights) naming `file`, the tensor and the byte offset in the file; see SafetensorsFile for what
/// is checked.
[[nodiscard]] SafetensorsHeader parse_safetensors_header(std::string_view text, std::uint64_t data_size,
                                                         const std::string& file);

/// CRC-32C of the list of tensors, as Metadata describes it.
[[nodiscard]] std::uint32_t checksum_of_list(const std::vector<TensorInfo>& tensors);

/// Eight lower-case hexadecimal digits.
[[nodiscard]] std::string checksum_text(std::uint32_t crc);

/// The byte at which `text` stops being UTF-8, or nothing if all of it is (RFC 3629: no overlong forms, no
/// surrogates).
[[nodiscard]] std::optional<std::size_t> find_invalid_utf8(std::string_view text) noexcept;

/// True if `name` holds a control character (below 0x20, or 0x7f).
[[nodiscard]] bool has_control_character(std::string_view name) noexcept;

}  // namespace slide
