#pragma once

#include "runtime/graph.h"

namespace slide::graphs {

/// LPIPS with AlexNet (Zhang, Isola, Efros, Shechtman, Wang, "The Unreasonable Effectiveness of Deep Features
/// as a Perceptual Metric", 2018; PyPI's lpips, version 0.1, net="alex"): the perceptual distance of two
/// pictures. Features behind the five ReLUs of AlexNet (torchvision's), each pixel's divided by its length;
/// their squared differences, weighted by the linear heads, averaged over the picture and summed.
/// Parameters by that package's state_dict: net.slice1.0 to net.slice5.10 and lin0.model.1 to lin4.model.1.
/// @param a, b  1×3×H×W in [0, 1], both sides at least 63
/// @return 1×1×1×1. Throws Error(kUsage) for shapes that do not fit.
Value lpips_alex(Value a, Value b);

}  // namespace slide::graphs
