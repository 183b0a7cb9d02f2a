#pragma once

// Small decoders for what the exporters write, independent of the encoders and of the libraries these use
// (zlib's inflate apart). They take well-formed files only and throw std::runtime_error for anything else.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

struct DecodedPng {
  int width = 0, height = 0, channels = 0, bits = 0;
  std::vector<std::uint16_t> samples;  ///< height · width · channels
};
DecodedPng independent_png(std::span<const std::uint8_t> bytes);

struct DecodedApng {
  std::vector<DecodedPng> frames;
  std::vector<int> delay_numerators, delay_denominators;
  std::uint32_t plays = 99;
};
DecodedApng independent_apng(std::span<const std::uint8_t> bytes);

struct DecodedGif {
  int width = 0, height = 0;
  int loops = -1;
  std::vector<int> delays;                        ///< 1/100 s
  std::vector<std::vector<std::uint8_t>> frames;  ///< RGB, as shown
};
DecodedGif independent_gif(std::span<const std::uint8_t> bytes);

std::vector<std::uint8_t> independent_lzw(std::span<const std::uint8_t> bytes, std::size_t symbols);
