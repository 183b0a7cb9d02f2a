#include "graphs/midas_io.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>

#include "ops/pointwise/pointwise.h"
#include "ops/resize/resize.h"
#include "runtime/error.h"

namespace slide::graphs {
namespace {

constexpr std::int64_t kMultiple = 32;
constexpr std::array<double, 3> kImageNetMean{0.485, 0.456, 0.406};
constexpr std::array<double, 3> kImageNetStd{0.229, 0.224, 0.225};

/// The multiple of 32 nearest to `side`, a tie to the even one as NumPy rounds, between 32 and the bound.
std::int64_t rounded(double side, std::int64_t upper_bound) {
  const double steps = side / static_cast<double>(kMultiple);
  auto result = static_cast<std::int64_t>(std::nearbyint(steps)) * kMultiple;
  if (result > upper_bound) result = static_cast<std::int64_t>(std::floor(steps)) * kMultiple;
  return std::max(result, kMultiple);
}

Value per_channel(Graph& g, std::string_view name, const std::array<double, 3>& values) {
  return g.constant(name, Tensor::from<double>({1, 3, 1, 1}, std::span<const double>(values)));
}

}  // namespace

ImageSize midas_working_size(ImageSize image, std::int64_t upper_bound) {
  if (image.height < 1 || image.width < 1 || upper_bound < kMultiple)
    throw Error(ErrorKind::kUsage, "MiDaS cannot bring an image of " + std::to_string(image.width) + "x" +
                                       std::to_string(image.height) + " pixels to at most " +
                                       std::to_string(upper_bound));
  const auto height = static_cast<double>(image.height);
  const auto width = static_cast<double>(image.width);
  const auto bound = static_cast<double>(upper_bound);
  const double scale = std::min(bound / height, bound / width);
  return {rounded(scale * height, upper_bound), rounded(scale * width, upper_bound)};
}

Value imagenet_normalise(Value image) {
  Graph& g = image.graph();
  const Value centred = ops::sub(image, per_channel(g, "mean", kImageNetMean));
  return ops::div(centred, per_channel(g, "std", kImageNetStd));
}

Value midas_preprocess(Value image, ImageSize size) {
  const auto scope = image.graph().scope("midas_preprocess");
  return imagenet_normalise(ops::resize_bicubic(image, size.height, size.width));
}

Value midas_postprocess(Value depth, ImageSize image) {
  const auto scope = depth.graph().scope("midas_postprocess");
  return ops::resize_bicubic(depth, image.height, image.width);
}

}  // namespace slide::graphs
