#include "graphs/midas_io.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "runtime/error.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors.h"

using namespace slide;
using namespace slide::graphs;

namespace {

SafetensorsFile vectors() {
  return SafetensorsFile::open(std::string(SLIDE_TEST_DATA) + "/midas_io.safetensors");
}

/// The crop of the photo as 1×3×H×W in [0,1].
Tensor photo(const SafetensorsFile& file) {
  const Tensor crop = file.tensor("crop");
  const std::int64_t pixels = crop.shape()[0] * crop.shape()[1];
  Tensor image(DType::kF64, {1, 3, crop.shape()[0], crop.shape()[1]});
  for (std::int64_t p = 0; p < pixels; ++p)
    for (std::int64_t c = 0; c < 3; ++c)
      image.mutable_data<double>()[static_cast<std::size_t>(c * pixels + p)] =
          crop.data<std::uint8_t>()[static_cast<std::size_t>(p * 3 + c)] / 255.0;
  return image;
}

struct Comparison {
  double difference;  // from OpenCV, after normalisation
  double slope;       // steepest within a row of OpenCV's result, per pixel of the photo
};

double steepest_in_rows(const Tensor& image) {
  const std::span<const float> x = image.data<float>();
  const auto width = static_cast<std::size_t>(image.shape()[-1]);
  double steepest = 0;
  for (std::size_t i = 1; i < x.size(); ++i)
    if (i % width != 0) steepest = std::max(steepest, std::abs(static_cast<double>(x[i]) - x[i - 1]));
  return steepest;
}

Comparison compare_with_opencv(const std::string& name, std::int64_t upper_bound) {
  const SafetensorsFile file = vectors();
  const Tensor expected = file.tensor(name);
  const Tensor image = photo(file);
  const ImageSize size = midas_working_size({image.shape()[2], image.shape()[3]}, upper_bound);
  CHECK(size == ImageSize{expected.shape()[1], expected.shape()[2]});
  Graph g;
  g.output("y", midas_preprocess(g.input("image", image.shape()), size));
  ReferenceExecutor run(g, WeightMap());
  run.run({{"image", image}});
  const Tensor& y = run.tensor("y");
  const double scale = static_cast<double>(size.width) / static_cast<double>(image.shape()[3]);
  return {max_abs_difference(y, expected.reshaped(y.shape())), scale * steepest_in_rows(expected)};
}

// OpenCV sums in float32: two times four products of up to 1.5 · 2^-24, divided by std >= 0.224, and the
// vectors are stored in float32.
constexpr double kOpenCvArithmetic = 2e-6;
// It also rounds sample positions to float32: those from 64 to 88 by up to 2^-18 of a pixel.
constexpr double kOpenCvPosition = 0x1p-18;

}  // namespace

TEST_CASE("the working size is the one the authors' transforms.py computes") {
  const Tensor table = vectors().tensor("sizes");
  const std::span<const std::int64_t> row = table.data<std::int64_t>();
  REQUIRE(table.shape()[0] > 300);
  for (std::size_t i = 0; i < row.size(); i += 5) {
    CAPTURE(row[i]);
    CAPTURE(row[i + 1]);
    CHECK(midas_working_size({row[i], row[i + 1]}, row[i + 2]) == ImageSize{row[i + 3], row[i + 4]});
  }
}

TEST_CASE("the working size of a long strip is at least 32 on its short side") {
  CHECK(midas_working_size({10, 4000}, 384) == ImageSize{32, 384});
  CHECK_THROWS_AS((void)midas_working_size({0, 10}, 384), Error);
  CHECK_THROWS_AS((void)midas_working_size({10, 10}, 31), Error);
}

TEST_CASE("preprocessing agrees with OpenCV's INTER_CUBIC on a photo, shrinking") {
  // 88 to 64 and 60 to 32 pixels: all positions are exact in float32.
  CHECK(compare_with_opencv("smaller", 64).difference <= kOpenCvArithmetic);
}

TEST_CASE("preprocessing agrees with OpenCV's INTER_CUBIC on a photo, enlarging") {
  // 88 to 96 pixels: positions are not exact. Measured: 3.2e-6, and 8e-7 against positions rounded as OpenCV
  // does.
  const Comparison c = compare_with_opencv("larger", 96);
  CHECK(c.difference <= kOpenCvArithmetic + kOpenCvPosition * c.slope);
}

TEST_CASE("postprocessing agrees with torch's bicubic interpolation") {
  const SafetensorsFile file = vectors();
  const Tensor depth = file.tensor("depth");
  const Tensor expected = file.tensor("restored");
  Graph g;
  const Value x = g.input("depth", {1, 1, depth.shape()[0], depth.shape()[1]});
  g.output("y", midas_postprocess(x, {expected.shape()[0], expected.shape()[1]}));
  ReferenceExecutor run(g, WeightMap());
  run.run({{"depth", depth.reshaped(x.shape())}});
  const Tensor& y = run.tensor("y");
  CHECK(max_abs_difference(y, expected.reshaped(y.shape())) <= 1e-12 * max_abs(expected));
}
