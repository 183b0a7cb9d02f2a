#pragma once

#include <string>
#include <vector>

#include "graphs/slide.h"
#include "render/image.h"
#include "render/layers.h"
#include "runtime/tensor.h"

namespace slide {

/// Between images as files hold them and tensors as graphs compute with them.

/// Interleaved H×W×C to planar 1×C×H×W, F32.
[[nodiscard]] Tensor tensor_from_image(const Image& image);
/// Planar 1×C×H×W, F32, to interleaved H×W×C.
[[nodiscard]] Image image_from_tensor(const Tensor& tensor);

/// What the numbers of a given map mean.
enum class DepthKind {
  kDisparity,  ///< larger is nearer
  kDepth,      ///< distance, larger is farther; 0 where it is missing
  kInverted,   ///< disparity with the sign turned: larger is farther, black is near
};
/// @throws Error(kUsage) unless the name is "disparity", "inverted" or "depth"
[[nodiscard]] DepthKind depth_kind(const std::string& name);

/// How many values of a map are missing: NaN, and of distances 0, by which sensors say that they saw nothing.
[[nodiscard]] std::size_t missing_values(const Image& map, DepthKind kind);

/// A map given by the user as disparity at the photo's size: depth z becomes 1/z (0 where it is infinite);
/// missing values are continued from those around, in disparity, by pull-push (render/cutout.h); then
/// bilinear resampling if the sizes differ. Not normalised: make_layers() does that.
/// @param name  the file, for messages
/// @throws Error(kBadInput) if the aspect ratios differ by more than 6 %, a depth is negative or a disparity
///   infinite (naming the first such pixel), or all values are missing
[[nodiscard]] Tensor disparity_from_map(const Image& map, DepthKind kind, int width, int height,
                                        const std::string& name);

/// A matte given by the user at the photo's size, clamped to [0, 1].
/// @throws Error(kBadInput) if the aspect ratios differ by more than 6 %
[[nodiscard]] Tensor matte_from_map(const Image& map, int width, int height, const std::string& name);

/// The image with its longer side at most `side` pixels, by averaging the area that each new pixel covers;
/// unchanged if it is not larger.
[[nodiscard]] Image shrink_to(const Image& image, int side);

/// What the rasterizer draws of what the graphs have made.
[[nodiscard]] Layers layers_from(const graphs::SlideLayers& made);

/// Every file that write_maps() may write into a folder.
[[nodiscard]] std::vector<std::string> map_files(const std::string& folder);

/// Writes the layers and all maps into a folder, which is made if it is missing: image.png (the front layer's
/// colours) and background.png with 16 bits, and D, D1, A, S, S_hat, H, matte, D_bg as .png with 16 bits and
/// as .pfm (and .exr in builds with OpenImageIO), those that there are.
/// @return the files written
std::vector<std::string> write_maps(const std::string& folder, const graphs::SlideLayers& made);

}  // namespace slide
