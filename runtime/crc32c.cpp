// Slicing by eight (Kounavis and Berry, "Novel Table Lookup-Based Algorithms for High-Performance CRC
// Generation", 2008): table k advances a byte's contribution by k further zero bytes, so eight bytes take
// eight independent look-ups.
#include "runtime/crc32c.h"

#include <array>
#include <bit>
#include <cstring>

namespace slide {
namespace {

using Tables = std::array<std::array<std::uint32_t, 256>, 8>;

constexpr Tables make_tables() {
  constexpr std::uint32_t kReflectedPolynomial = 0x82F63B78u;
  Tables tables{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1u) != 0 ? kReflectedPolynomial : 0u);
    tables[0][byte] = crc;
  }
  for (std::size_t k = 1; k < 8; ++k)
    for (std::size_t byte = 0; byte < 256; ++byte)
      tables[k][byte] = (tables[k - 1][byte] >> 8) ^ tables[0][tables[k - 1][byte] & 0xFFu];
  return tables;
}

constexpr Tables kTables = make_tables();

static_assert(std::endian::native == std::endian::little, "words are read as little-endian");

std::uint32_t crc_of_words_by_table(const std::byte* p, std::size_t words, std::uint32_t crc) noexcept {
  for (; words > 0; --words, p += 8) {
    std::uint64_t word;
    std::memcpy(&word, p, sizeof word);
    word ^= crc;
    crc = 0;
    for (std::size_t k = 0; k < 8; ++k) crc ^= kTables[7 - k][(word >> (8 * k)) & 0xFFu];
  }
  return crc;
}

#if defined(__x86_64__)
// The instruction computes this very polynomial; it is in every processor with SSE4.2.
__attribute__((target("sse4.2"))) std::uint32_t crc_of_words_by_instruction(const std::byte* p,
                                                                            std::size_t words,
                                                                            std::uint32_t crc) noexcept {
  std::uint64_t wide = crc;
  for (; words > 0; --words, p += 8) {
    std::uint64_t word;
    std::memcpy(&word, p, sizeof word);
    wide = __builtin_ia32_crc32di(wide, word);
  }
  return static_cast<std::uint32_t>(wide);
}

std::uint32_t crc_of_words(const std::byte* p, std::size_t words, std::uint32_t crc) noexcept {
  static const bool has_instruction = __builtin_cpu_supports("sse4.2") != 0;
  return (has_instruction ? crc_of_words_by_instruction : crc_of_words_by_table)(p, words, crc);
}
#else
constexpr auto crc_of_words = crc_of_words_by_table;
#endif

}  // namespace

std::uint32_t crc32c(std::span<const std::byte> bytes, std::uint32_t crc_so_far) noexcept {
  const std::size_t words = bytes.size() / 8;
  std::uint32_t crc = crc_of_words(bytes.data(), words, ~crc_so_far);
  for (const std::byte b : bytes.subspan(8 * words))
    crc = (crc >> 8) ^ kTables[0][(crc ^ std::to_integer<std::uint32_t>(b)) & 0xFFu];
  return ~crc;
}

}  // namespace slide
