// What direct convolutions of a lower precision do before: bilinear upsampling, and joining channels.

#include <algorithm>

#include "ops/conv2d/direct/direct.h"
#include "ops/resize/resized_rows.h"
#include "runtime/threads.h"

namespace slide::ops {
namespace {

Conv2dFusion behind_upsampling(Conv2dFusion fusion) {
  if (fusion.upsample_input == Upsampling::kBilinear) fusion.upsample_input = Upsampling::kNone;
  fusion.joined = 0;
  return fusion;
}

/// Bytes of the image made of that one and joined channels.
std::size_t upsampled_bytes(const Nchw& image, std::int64_t joined) {
  const std::int64_t channels = image.c > 0 ? image.c + joined : 0;
  return Tensor::aligned(static_cast<std::size_t>(4 * image.n * channels * image.plane()) * sizeof(float));
}

}  // namespace

Conv2dDirectLow::Conv2dDirectLow(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                 const Conv2dFusion& fusion, Precision precision)
    : Conv2dDirect(routines, geometry, behind_upsampling(fusion), precision),
      precision_(precision),
      image_{geometry.batch, fusion.upsample_input == Upsampling::kBilinear ? geometry.ic - fusion.joined : 0,
             geometry.height / 2, geometry.width / 2},
      joined_(fusion.joined),
      resize_(resize_routines(routines.isa)) {}

bool Conv2dDirectLow::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return Conv2dDirect::fits(g, behind_upsampling(fusion));
}

/// An upsampled number is rounded twice in each direction; of integers that is within the scale.
double Conv2dDirectLow::error_factor() const noexcept {
  const double upsampling = precision_ == Precision::kBf16 && image_.c > 0 ? 1.01 * 4 * 0x1p-16 : 0;
  return Conv2dDirect::error_factor() + upsampling;
}

std::size_t Conv2dDirectLow::scratch_bytes() const noexcept {
  return upsampled_bytes(image_, joined_) + Conv2dDirect::scratch_bytes();
}

void Conv2dDirectLow::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
  if (image_.c == 0) return Conv2dDirect::run(arrays, scratch);
  ResizeParams params;
  params.size = {2 * image_.h, 2 * image_.w};
  Conv2dArrays upsampled = arrays;
  auto* to = static_cast<float*>(static_cast<void*>(scratch.data()));
  const Nchw one{1, image_.c, image_.h, image_.w};
  const std::int64_t plane = 4 * image_.plane(), channels = image_.c + joined_;
  for (std::int64_t n = 0; n < image_.n; ++n) {
    float* image = to + n * channels * plane;
    resize_planes(resize_, ResizeOp(params), one, arrays.x + n * image_.c * image_.plane(), nullptr, image);
    parallel_for(joined_, [&](std::int64_t channel) {
      std::copy_n(arrays.joined + (n * joined_ + channel) * plane, plane,
                  image + (image_.c + channel) * plane);
    });
  }
  upsampled.x = to;
  Conv2dDirect::run(upsampled, scratch.subspan(upsampled_bytes(image_, joined_)));
}

}  // namespace slide::ops
