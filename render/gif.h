#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "render/frame_sink.h"

namespace slide {

/// An endless GIF89a animation. One palette of 255 colours serves all frames, and the dither depends on
/// colour and place only (render/palette.h), so nothing flickers; pixels that nearly keep their colour
/// from the frame before are left transparent, and strings that LZW already knows stand for nearly equal
/// ones: a pixel's squared error grows by at most 150 by that. Frames wait in a temporary file until the last
/// one is known.
///
/// GIF counts time in 1/100 s and viewers slow down what is shown for less than 2/100: at most 50 frames per
/// second (Error(kUsage) above), each shown for 2 or more, so that the whole lasts as long as it should. At
/// most 65535 pixels a side.
[[nodiscard]] std::unique_ptr<FrameSink> make_gif_sink(const std::string& path);

/// GIF's variant of LZW: 8-bit symbols, codes of 9 to 12 bits packed least significant bit first, beginning
/// with a clear code and ending with the end code; a full table of 4096 codes is cleared. No sub-blocks.
[[nodiscard]] std::vector<std::uint8_t> lzw_compress(std::span<const std::uint8_t> symbols);

}  // namespace slide
