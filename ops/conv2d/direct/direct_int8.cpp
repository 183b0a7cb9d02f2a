// What sets 8-bit integers apart from the other words of direct convolutions: bilinear upsampling before it,
// and what their error is measured against.

#include <algorithm>
#include <cmath>
#include <vector>

#include "ops/conv2d/conv2d_op.h"
#include "ops/conv2d/direct/direct.h"
#include "ops/conv2d/few_filters/few_filters.h"
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

Conv2dDirectInt8::Conv2dDirectInt8(const Conv2dRoutines& routines, const Conv2dGeometry& geometry,
                                   const Conv2dFusion& fusion)
    : Conv2dDirect(routines, geometry, behind_upsampling(fusion), Precision::kInt8),
      image_{geometry.batch, fusion.upsample_input == Upsampling::kBilinear ? geometry.ic - fusion.joined : 0,
             geometry.height / 2, geometry.width / 2},
      joined_(fusion.joined),
      resize_(resize_routines(routines.isa)) {}

bool Conv2dDirectInt8::fits(const Conv2dGeometry& g, const Conv2dFusion& fusion) noexcept {
  return Conv2dDirect::fits(g, behind_upsampling(fusion)) && g.group_ic >= 8 &&
         !Conv2dFewFilters::beats_lower(g, fusion);
}

std::size_t Conv2dDirectInt8::scratch_bytes() const noexcept {
  return upsampled_bytes(image_, joined_) + Conv2dDirect::scratch_bytes();
}

void Conv2dDirectInt8::run(const Conv2dArrays& arrays, std::span<std::byte> scratch) const {
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

void Conv2dDirectInt8::error_scale(const Conv2dGeometry& g, std::span<const Tensor> inputs, const Tensor& x,
                                   std::span<double> scale) {
  std::vector<Tensor> wide;
  for (const Tensor& t : inputs) {
    wide.push_back(t.clone());
    for (double& v : wide.back().mutable_data<double>()) v = std::fabs(v);
  }
  std::vector<double> products(scale.size());
  conv2d_reference(g, wide, products);
  double low = 0;
  double high = 0;
  const auto image = static_cast<std::size_t>(x.count() / x.shape()[0]);
  for (std::size_t n = 0; n < static_cast<std::size_t>(x.count()); n += image) {
    const std::span<const double> values = x.data<double>().subspan(n, image);
    if (!std::ranges::all_of(values, [](double v) { return std::isfinite(v); })) continue;  // as in a run
    low = std::min(low, *std::ranges::min_element(values));
    high = std::max(high, *std::ranges::max_element(values));
  }
  for (double& v : wide[0].mutable_data<double>()) v += 1.001 * (high - low) / 255 / 2;
  const std::span<double> w = wide[1].mutable_data<double>();
  const auto depth = static_cast<std::size_t>(g.depth());
  for (std::size_t o = 0; o < w.size(); o += depth) {
    const double largest = *std::max_element(w.begin() + static_cast<std::ptrdiff_t>(o),
                                             w.begin() + static_cast<std::ptrdiff_t>(o + depth));
    for (std::size_t k = o; k < o + depth; ++k) w[k] += 1.001 * largest / 127 / 2;
  }
  conv2d_reference(g, wide, scale);
  for (std::size_t i = 0; i < scale.size(); ++i) scale[i] += 0x1p-22 * scale[i] - products[i] + 0x1p-100;
}

}  // namespace slide::ops
