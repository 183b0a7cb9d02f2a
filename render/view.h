#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "render/camera.h"
#include "render/layers.h"
#include "render/mesh.h"

namespace slide {

struct RenderOptions {
  int width = 0;  ///< of the view; 0: the photo's. The two go together.
  int height = 0;
  bool supersample = false;  ///< draw at twice the size and average 2×2 pixels
  int band_rows = 0;         ///< rows drawn by one thread at a time; 0 chooses. Does not change the result.
};

/// The largest width and height of a view.
inline constexpr int kMaxViewSide = 32768;

/// A displacement of `pixels` in any of the views, as the tolerance in disparity for adaptive_mesh():
/// pixels / largest_parallax_rate(). 1, the whole range, where the views do not move anything.
[[nodiscard]] double mesh_tolerance(const Camera& camera, const std::vector<View>& views, double pixels);

/// Draws views of a 3D photo. Prepared once from the layers, of which it keeps no reference.
///
/// For each layer the nearest surface at the pixel's centre, textured with I and A by bilinear filtering;
/// then eq. 4, I_T* = A_T I_T + (1 - A_T) I_bg_T, with A_T = 0 where the foreground's mesh does not cover a
/// pixel, and black where the background's does not. Without a background there is nothing to see through to:
/// the foreground is opaque.
///
/// With the identity as view, at the photo's size, an opaque foreground gives back the photo within 1/255.
/// The same bytes at any thread count and band size. Per vertex and pixel there are IEEE operations only,
/// none of them contracted, and no libm function: other CPUs give the same bytes for the same view.
class ViewRenderer {
 public:
  /// @param tolerance  of the adaptive meshes, in disparity (mesh_tolerance()); none for full meshes
  /// @throws Error(kBadInput) as check_layers(), and when the camera's size is not that of the layers
  ViewRenderer(const Layers& layers, const Camera& camera, std::optional<double> tolerance = std::nullopt);
  ~ViewRenderer();
  ViewRenderer(ViewRenderer&&) noexcept;
  ViewRenderer& operator=(ViewRenderer&&) noexcept;

  /// Draws a view into `out`, H×W×3, whose memory is used again if it has the size. `coverage`, if wanted,
  /// becomes H×W×1: 1 where a layer was drawn, 0 where there is nothing but black, the share of it when
  /// supersampled. Uses this object's scratch memory: one call at a time.
  /// @throws Error(kUsage) for a view side outside 1 to kMaxViewSide, or half of that when supersampling
  void render(const View& view, const RenderOptions& options, Image& out, Image* coverage = nullptr);

  /// Triangles of both layers' meshes.
  [[nodiscard]] std::size_t triangle_count() const noexcept;
  [[nodiscard]] const Mesh& foreground_mesh() const noexcept;
  /// The background's mesh, or null.
  [[nodiscard]] const Mesh* background_mesh() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace slide
