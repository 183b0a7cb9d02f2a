#include "runtime/crc32c.h"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

using namespace slide;

namespace {

std::uint32_t crc_of(std::string_view text) { return crc32c(std::as_bytes(std::span(text))); }

/// The definition, bit by bit.
std::uint32_t crc_by_bits(std::span<const std::byte> bytes) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const std::byte byte : bytes) {
    crc ^= std::to_integer<std::uint32_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (0x82F63B78u & (0u - (crc & 1u)));
  }
  return ~crc;
}

}  // namespace

TEST_CASE("CRC-32C gives the published values") {
  CHECK(crc_of("123456789") == 0xE3069283u);  // the check value of the CRC catalogue
  // RFC 3720, appendix B.4
  CHECK(crc32c(std::vector<std::byte>(32, std::byte{0})) == 0x8A9136AAu);
  CHECK(crc32c(std::vector<std::byte>(32, std::byte{0xFF})) == 0x62A8AB43u);
  std::vector<std::byte> rising;
  for (int i = 0; i < 32; ++i) rising.push_back(static_cast<std::byte>(i));
  CHECK(crc32c(rising) == 0x46DD794Eu);
  CHECK(crc_of("") == 0u);
}

TEST_CASE("CRC-32C equals its definition at every length and offset, and can be taken in pieces") {
  std::vector<std::byte> bytes;
  for (std::uint32_t i = 0, x = 1; i < 80; ++i, x = x * 1664525u + 1013904223u)
    bytes.push_back(static_cast<std::byte>(x >> 24));
  for (std::size_t begin = 0; begin < 9; ++begin)
    for (std::size_t length = 0; begin + length <= bytes.size(); ++length) {
      const std::span<const std::byte> part = std::span(bytes).subspan(begin, length);
      REQUIRE(crc32c(part) == crc_by_bits(part));
      REQUIRE(crc32c(part.subspan(length / 3), crc32c(part.first(length / 3))) == crc32c(part));
    }
}
