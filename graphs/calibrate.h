#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "runtime/calibration.h"
#include "runtime/run.h"
#include "runtime/tensor.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// Calibrates a model for 8-bit integers: runs its fused graph in float32 on photos, made into its inputs as
/// photo_run() does. A layer's range is the one with the smallest mean squared error of the values that its
/// input takes, rounded to 256 steps or cut off, by histograms of kCalibrationBins bins over all photos. Then
/// every layer alone is computed in 8-bit integers with that range, and the error that this makes at the
/// outputs is the layer's: its root mean square relative to the output's, the largest of all outputs and
/// photos. Three images are added to the photos, on which errors are larger than on most: black, white and a
/// ramp. So the time is that of one run for each layer and image.
/// @param photos  each 1×3×H×W in [0, 1], at least one
/// @param longer  as in photo_run()
/// @param progress  called before each run; returning false ends with Error(kCancelled)
/// Throws Error(kUsage) if there is no photo and as photo_run(), and as FastExecutor does.
[[nodiscard]] Calibration calibrate(std::string_view model, const WeightSource& weights,
                                    std::span<const Tensor> photos, std::int64_t longer = 0,
                                    const ProgressCallback& progress = {});

inline constexpr int kCalibrationBins = 2048;

/// The values that a tensor was seen to take.
class ValueHistogram {
 public:
  /// For values in [low, high], where low <= 0 <= high.
  ValueHistogram(float low, float high);
  void add(std::span<const float> values);
  /// low <= 0 <= high: the range within which 256 equal steps, one of them zero, have the smallest mean
  /// squared error, what lies outside cut off. Each end is tried at 40 parts of the largest value seen.
  [[nodiscard]] Range best_range() const;

 private:
  [[nodiscard]] double mean_square(double low, double high) const;
  double low_, high_;
  std::vector<double> counts_;  // of values that are not zero, which is always exact
};

}  // namespace slide::graphs
