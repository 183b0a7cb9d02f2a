#pragma once

#include "runtime/graph.h"
#include "runtime/weights.h"

namespace slide::graphs {

/// What FBA matting starts from; all of one H×W.
struct FbaInputs {
  Value image;               ///< 1×3×H×W, RGB in [0,1]
  Value two_chan_trimap;     ///< 1×2×H×W: 1 where surely background; 1 where surely foreground
  Value image_n;             ///< 1×3×H×W: image normalised with ImageNet's mean and standard deviation
  Value trimap_transformed;  ///< 1×6×H×W: three Gaussians of the distance to each of the two regions
};

/// Whether filters are standardised in the graph. The authors' eval() rewrites them in place after loading
/// (networks/layers_WS.py), so published files hold raw filters, but a state_dict saved from a model in use
/// holds standardised ones.
struct FbaConfig {
  bool standardise_weights = false;

  /// True unless every filter of the first layer has mean zero already (to 1e-4 of its standard deviation,
  /// which training does not reach by chance). False if `weights` makes tensors up, lists shapes without
  /// values, or has no such layer.
  static FbaConfig from_weights(const WeightSource& weights);
};

/// FBA matting (Forte and Pitié, "F, B, Alpha Matting", 2020; MarcoForte/FBA_Matting networks/models.py):
/// ResNet-50 with group norm, dilated to stride 8, a pyramid pooling decoder, and the closed-form fusion of
/// alpha, F and B.
/// @return 1×7×H×W: alpha, foreground RGB, background RGB, all in [0,1]
/// Throws Error(kUsage) unless the sides are multiples of 8.
Value fba(const FbaInputs& inputs, const FbaConfig& config = {});

}  // namespace slide::graphs
