#include "graphs/photo_inputs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>

#include "graphs/catalogue.h"
#include "graphs/midas_io.h"
#include "ops/pointwise/pointwise.h"
#include "ops/reduce/reduce.h"
#include "ops/resize/resize.h"
#include "ops/tensor_shape/tensor_shape.h"
#include "runtime/error.h"
#include "runtime/reference_executor.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kDefaultLonger = 256;

/// A side scaled and brought to a multiple of `multiple`, at least one.
std::int64_t fitting(double side, std::int64_t multiple) {
  const auto steps = static_cast<std::int64_t>(std::llround(side / static_cast<double>(multiple)));
  return std::max<std::int64_t>(steps, 1) * multiple;
}

ImageSize working_size(const SizeRule& rule, ImageSize photo, std::int64_t longer) {
  if (longer == 0 && rule.square != 0) return {rule.square, rule.square};
  const std::int64_t own = std::max(photo.height, photo.width);
  if (longer == 0) longer = rule.upper_bound != 0 ? rule.upper_bound : std::min(own, kDefaultLonger);
  const double scale = static_cast<double>(longer) / static_cast<double>(own);
  return {fitting(scale * static_cast<double>(photo.height), rule.multiple),
          fitting(scale * static_cast<double>(photo.width), rule.multiple)};
}

/// 1×C×H×W of a function of channel and pixel.
Tensor planes(ImageSize size, std::int64_t channels,
              const std::function<double(std::int64_t c, std::int64_t y, std::int64_t x)>& value) {
  Tensor t(DType::kF64, {1, channels, size.height, size.width});
  const std::span<double> out = t.mutable_data<double>();
  std::size_t i = 0;
  for (std::int64_t c = 0; c < channels; ++c)
    for (std::int64_t y = 0; y < size.height; ++y)
      for (std::int64_t x = 0; x < size.width; ++x) out[i++] = value(c, y, x);
  return t;
}

/// 1 inside the hole: the middle half of both sides.
Tensor hole(ImageSize size) {
  const auto middle = [](std::int64_t i, std::int64_t n) { return 4 * i >= n && 4 * i < 3 * n; };
  return planes(size, 1, [&](std::int64_t, std::int64_t y, std::int64_t x) {
    return middle(y, size.height) && middle(x, size.width) ? 1.0 : 0.0;
  });
}

/// Radii of the discs that bound sure foreground and sure background, in pixels.
struct Discs {
  explicit Discs(ImageSize s)
      : size(s),
        foreground(0.25 * static_cast<double>(std::min(s.height, s.width))),
        background(0.375 * static_cast<double>(std::min(s.height, s.width))) {}
  /// How far a pixel is from the sure background (channel 0) or foreground (1): 0 inside of it.
  [[nodiscard]] double distance(std::int64_t channel, std::int64_t y, std::int64_t x) const {
    const double radius = std::hypot(static_cast<double>(y) - 0.5 * static_cast<double>(size.height - 1),
                                     static_cast<double>(x) - 0.5 * static_cast<double>(size.width - 1));
    return std::max(channel == 0 ? background - radius : radius - foreground, 0.0);
  }
  ImageSize size;
  double foreground, background;
};

/// 1 where a pixel is surely background (channel 0), surely foreground (1).
Tensor trimap(ImageSize size) {
  const Discs discs(size);
  return planes(size, 2, [&](std::int64_t c, std::int64_t y, std::int64_t x) {
    return discs.distance(c, y, x) == 0 ? 1.0 : 0.0;
  });
}

/// exp(-d² / (2·(s·320)²)) with s = 0.02, 0.08, 0.16 of the distances to both regions (MarcoForte/FBA_Matting
/// networks/transforms.py).
Tensor trimap_transformed(ImageSize size) {
  const Discs discs(size);
  return planes(size, 6, [&](std::int64_t c, std::int64_t y, std::int64_t x) {
    constexpr std::array<double, 3> kSigma{0.02 * 320, 0.08 * 320, 0.16 * 320};
    const double d = discs.distance(c / 3, y, x) / kSigma[static_cast<std::size_t>(c % 3)];
    return std::exp(-0.5 * d * d);
  });
}

/// A soft disc: 1 in the sure foreground, 0 in the sure background, linear between.
Tensor soft_disc(ImageSize size) {
  const Discs discs(size);
  return planes(size, 1, [&](std::int64_t, std::int64_t y, std::int64_t x) {
    return discs.distance(0, y, x) / std::max(discs.background - discs.foreground, 1e-9);
  });
}

/// A model's input of that name. `photo` is the photo in a graph.
Value model_input(std::string_view model, std::string_view name, Value photo, ImageSize size) {
  Graph& g = photo.graph();
  const auto image = [&] { return ops::clip(ops::resize_bicubic(photo, size.height, size.width), 0, 1); };
  const auto disparity = [](Value rgb) { return ops::reduce_mean(rgb, {1}); };
  if (name == "x" && model.starts_with("slide_")) return ops::affine(image(), 2, -1);
  if (name == "x" || name == "image_n") return midas_preprocess(photo, size);
  if (name == "image") return image();
  if (name == "disparity") return disparity(image());
  if (name == "mask" || name == "hole") return g.constant("middle", hole(size));
  if (name == "coarse") return ops::clip(g.constant("soft_disc", soft_disc(size)), 0, 1);
  if (name == "two_chan_trimap") return g.constant("discs", trimap(size));
  if (name == "trimap_transformed") return g.constant("disc_distances", trimap_transformed(size));
  if (name == "rgbd") {
    const Value rgb = image();
    return ops::affine(ops::concat({rgb, disparity(rgb)}, 1), 2, -1);
  }
  throw Error(ErrorKind::kInternal, "no photo can be made into the input " + std::string(name));
}

}  // namespace

PhotoRun photo_run(std::string_view model, const Tensor& photo, const WeightSource& weights,
                   std::int64_t longer) {
  const Model& entry = find_model(model);
  if (longer < 0) throw Error(ErrorKind::kUsage, "the size " + std::to_string(longer) + " is negative");
  const ImageSize size = working_size(entry.size, {photo.shape()[2], photo.shape()[3]}, longer);
  Graph prepare;
  const Value image = prepare.input("photo", photo.shape());
  for (const std::string_view name : entry.inputs)
    prepare.output(name, model_input(model, name, image, size));
  ReferenceExecutor executor(prepare, WeightMap());
  executor.run({{"photo", photo}});

  PhotoRun run;
  run.graph = build_model(model, {.height = size.height, .width = size.width, .weights = &weights});
  for (const std::string_view name : entry.inputs) run.inputs[std::string(name)] = executor.tensor(name);
  return run;
}

}  // namespace slide::graphs
