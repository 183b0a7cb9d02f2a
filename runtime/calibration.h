#pragma once

#include <map>
#include <string>
#include <string_view>

#include "runtime/graph.h"
#include "runtime/op.h"

namespace slide {

/// What calibration found for one layer.
struct LayerCalibration {
  Range range;   ///< of its input, for 8-bit integers: what lies outside is cut off
  double error;  ///< root mean square of the error at the network's outputs, relative to theirs, with this
                 ///< layer alone in 8-bit integers
};

/// What photos showed of a network, by the layers' weights: see calibration_key().
struct Calibration {
  std::map<std::string, LayerCalibration, std::less<>> layers;

  /// The entry of a node, null if there is none.
  [[nodiscard]] const LayerCalibration* find(const Graph& graph, int node) const;
};

/// The name a layer has in a calibration: that of the first parameter of rank 2 or more that its second
/// input, the weight, is or is computed from; empty if there is none. Node names would not do, they depend on
/// what else is in the graph.
[[nodiscard]] std::string calibration_key(const Graph& graph, int node);

/// The key of a safetensors file's metadata that holds a calibration as JSON:
///   {"version": 1, "layers": {"NAME": {"range": [low, high], "error": e}, ...}}
inline constexpr std::string_view kCalibrationKey = "calibration";

[[nodiscard]] std::string text_of(const Calibration& calibration);

/// Reads that text. Throws Error(kBadWeights) naming `source` and the layer unless it is such an object, its
/// ranges are finite with low <= 0 <= high and low < high, and its errors are finite and not negative.
[[nodiscard]] Calibration parse_calibration(std::string_view text, const std::string& source);

}  // namespace slide
