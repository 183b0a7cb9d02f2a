#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "render/image.h"

namespace slide {

/// A depth map that a phone has put into its JPEG, as it lies there. Values v in [0, 1] mean distances z:
/// RangeLinear z = near + v (far - near), RangeInverse 1/z = 1/near + v (1/far - 1/near).
struct EmbeddedDepth {
  std::vector<std::uint8_t> file;  ///< a JPEG or PNG file
  bool inverse = true;             ///< RangeInverse
  double near = 0, far = 0;        ///< 0 where the file does not say
};

/// Whether a JPEG says that it holds a depth map.
[[nodiscard]] bool has_embedded_depth(std::span<const std::uint8_t> jpeg);

/// The depth map of a JPEG: Google's GDepth (in base64 in its XMP, "Depthmap Metadata"), or Dynamic Depth 1.0
/// (a picture behind the photo, of which the XMP's Container:Directory tells the length and DepthMap:DepthURI
/// the name). Of several maps the first.
/// @return nothing if the file says nothing of one
/// @throws Error(kBadInput) naming the file if what it says of one does not fit what it holds
[[nodiscard]] std::optional<EmbeddedDepth> find_embedded_depth(std::span<const std::uint8_t> jpeg,
                                                               const std::string& name);

/// The decoded map, H×W×1 in [0, 1], as disparity (larger is nearer). Disparity is known up to scale and
/// offset, so RangeInverse needs neither near nor far.
/// @throws Error(kBadInput) if RangeLinear has no distances 0 < near < far
[[nodiscard]] Image disparity_of(const EmbeddedDepth& depth, Image map, const std::string& name);

}  // namespace slide
