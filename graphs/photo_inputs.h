#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include "runtime/graph.h"
#include "runtime/run.h"
#include "runtime/tensor.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// A model's graph and inputs for it made from one photo.
struct PhotoRun {
  std::unique_ptr<Graph> graph;
  NamedTensors inputs;  ///< F64
};

/// Builds a model for a photo, for looking at its arithmetic on natural images. The photo is brought to the
/// model's working size (bicubic, a = -0.75) and becomes its input, in the range or with the normalisation
/// that the network takes. What a model needs beside a photo is made up: for inpainting the mean of the
/// colours serves as disparity and the hole is the middle half of both sides; for matting the trimap is two
/// discs about the centre, sure foreground within a quarter of the shorter side, sure background beyond three
/// eighths, and the coarse matte goes from one to zero between.
/// @param photo   1×3×H×W, RGB in [0, 1]
/// @param longer  the longer side the photo is brought to; 0: the model's own rule, and at most 256 for
///                models that take photos as large as they are
/// Throws Error(kUsage) for an unknown model or a size it cannot be built for, Error(kBadWeights) if the
/// shapes of the weights fit no variant of it.
[[nodiscard]] PhotoRun photo_run(std::string_view model, const Tensor& photo, const WeightSource& weights,
                                 std::int64_t longer = 0);

}  // namespace slide::graphs
