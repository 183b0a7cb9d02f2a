#pragma once

#include <string>

#include "render/camera.h"
#include "render/layers.h"

namespace slide {

struct HtmlOptions {
  std::string title = "3D photo";  ///< any text; shown as the page's title
  std::string alt;                 ///< what is to be seen, for screen readers; any text; empty: the title
  double parallax_percent = 4;     ///< the largest parallax, in percent: parallax_pixels(); 0 to 50
  double focus = 0.5;              ///< the disparity that stands still
  int jpeg_quality = 92;
  int mesh_side = 640;  ///< vertices along the longer side, at most; 2 to 4096
};

/// The 3D photo as one HTML file that needs nothing else: layers, program and style are in it, and its
/// content security policy forbids it every network access. It draws the layers with WebGL 2 as the
/// rasterizer does (one textured height field per layer, z-buffer, eq. 4 of the paper), seen from a camera
/// that moves sideways with mouse, touch, device tilt or arrow keys, or by itself when nobody does; the view
/// is cropped so that the photo's edge never shows. The photo itself is there at once; without WebGL 2 or
/// scripts it stays. In a frame of another page, a finger that goes up or down scrolls that page.
///
/// Colours are JPEG, visibility is 8-bit PNG at full size, disparity 16 bits in a PNG's red and green at the
/// resolution of the mesh.
/// @throws Error(kBadInput) for layers that check_layers refuses; Error(kUsage) for options out of range
[[nodiscard]] std::string encode_html(const Layers& layers, const Camera& camera,
                                      const HtmlOptions& options = {});

/// The same into a file that appears when it is complete.
void write_html(const std::string& path, const Layers& layers, const Camera& camera,
                const HtmlOptions& options = {});

}  // namespace slide
