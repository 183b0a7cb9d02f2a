#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "render/frame_sink.h"

namespace slide {

/// Uncompressed YUV4MPEG2 video: 8-bit 4:4:4 Y'CbCr with BT.709's matrix in limited range (Y' 16..235, Cb and
/// Cr 16..240), square pixels, progressive. The format has no word for the matrix; players assume BT.709 from
/// HD sizes on, others may need to be told. The path "-" is standard output; a pipe or a device is written
/// directly, a file appears when it is complete.
[[nodiscard]] std::unique_ptr<FrameSink> make_y4m_sink(const std::string& path);

/// The header line, and a frame with its own header, of such a stream.
[[nodiscard]] std::string y4m_header(const FrameFormat& format);
[[nodiscard]] std::vector<std::uint8_t> y4m_frame(const Image& image);

}  // namespace slide
