#pragma once

#include <memory>
#include <string>

#include "render/frame_sink.h"

namespace slide {

/// An endless animated PNG (PNG third edition, section 11.3.2: acTL, fcTL, fdAT), 8-bit RGB, every frame
/// whole. Programs that do not know animation show its first frame. One single frame makes a plain PNG.
[[nodiscard]] std::unique_ptr<FrameSink> make_apng_sink(const std::string& path);

}  // namespace slide
