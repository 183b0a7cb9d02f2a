#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "runtime/calibration.h"
#include "runtime/dtype.h"
#include "runtime/weights.h"
#include "weights_tools/weight_reader.h"

namespace slide {

struct ConvertOptions {
  /// A model of graphs::catalogue(), which the tensors must fit; empty: whichever they fit; "any": none need
  /// fit.
  std::string model;
  DType dtype =
      DType::kF32;  ///< of floating-point tensors in the result: kF32, kF16 or kBF16; others stay as they are
  /// Calibrates the converted weights for the model named; the result is stored. Empty: a safetensors
  /// source's own calibration is kept.
  std::function<Calibration(const std::string& model, const WeightSource& weights)> calibrate = {};
  /// Whether the output may replace a file that convert() has not made, too; never the file that is read.
  bool overwrite = false;
};

struct ConvertReport {
  std::string model;  ///< "any" if none was asked for
  std::size_t tensors = 0;
  std::uint64_t bytes = 0;            ///< of their data
  std::string sha256;                 ///< of the source file
  std::size_t calibrated = 0;         ///< layers
  std::vector<std::string> warnings;  ///< one sentence each
};

/// Writes the tensors of `reader` to a safetensors file, with the metadata `model`, `source_file` (the name
/// without folders) and `source_sha256`; a safetensors source's own metadata is kept. In memory there is one
/// storage of the source at a time, and a block of the result. The file appears when it is complete, its
/// calibration included; until then an older one of that name stays as it was. Only a file that convert()
/// has made and nobody has changed since is replaced, told by the metadata and the checksums. Throws
/// Error(kBadWeights) if the tensors fit no model, listing what is missing or unexpected, do not match their
/// checksums, hold a value that the dtype cannot, or one that is not finite (of "any" model only a warning);
/// Error(kUsage) for an unknown model, if the output is the file that is read or another one that would be
/// lost; Error(kOutput) if it cannot be written.
ConvertReport convert(const WeightReader& reader, const std::string& output, const ConvertOptions& options);

/// How the tensors fit the models of the catalogue.
struct Detection {
  std::string model;   ///< empty if they fit none
  std::string detail;  ///< what is missing or unexpected for that model or the closest, and what else fits
};
[[nodiscard]] Detection detect_model(const WeightReader& reader);

/// The digits of the SHA-256 that PyTorch's convention puts at the end of a file's name
/// ("midas_v21-f6b98070.pt"): at least eight after a hyphen.
[[nodiscard]] std::optional<std::string> hash_in_name(const std::string& path);

/// A table of all tensors: name, dtype, shape, bytes; then the total, the model and the metadata.
[[nodiscard]] std::string listing(const WeightReader& reader);

/// Reads everything, compares the checksums that the file has, and looks for values that are not finite;
/// throws Error(kBadWeights) for the first defect, else returns one sentence on what was found good.
[[nodiscard]] std::string verify(const WeightReader& reader);

}  // namespace slide
