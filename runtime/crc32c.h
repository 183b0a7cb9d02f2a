#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace slide {

/// CRC-32C of `bytes` (Castagnoli polynomial 0x1EDC6F41, reflected, initial value and final xor 0xFFFFFFFF;
/// RFC 3720, appendix B.4). A text can be taken in pieces: crc32c(b, crc32c(a)) is the CRC of a followed by
/// b.
[[nodiscard]] std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t crc_so_far = 0) noexcept;

}  // namespace slide
