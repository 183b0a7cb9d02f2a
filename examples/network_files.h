#pragma once

#include <memory>
#include <string>
#include <vector>

#include "graphs/slide.h"

namespace slide {

/// Networks of a 3D photo by the files that hold their weights.
class NetworkFiles {
 public:
  /// A network from a file that slide_convert wrote, or, where `file` is empty, from the weights inside this
  /// program; not chosen if there are none. The file name "formula" stands for made-up weights: what the
  /// network then says means nothing, but its speed and memory are real.
  /// @param model  its name, if the file does not tell; may be empty
  /// @param default_model  the name of the weights inside
  /// @param role  "depth", "inpaint", "saliency", "matting": for messages
  /// @throws Error(kBadWeights) for a file that cannot be read or does not say what it is for, Error(kUsage)
  /// for an unknown model, and for one whose weights are neither given nor inside
  graphs::NetworkChoice open(const std::string& file, const std::string& model,
                             const std::string& default_model, const std::string& role);

 private:
  std::vector<std::unique_ptr<WeightSource>> sources_;
};

/// The network whose weights refine a saliency network's mattes where none is asked for: slide_rim has learnt
/// to correct slide_matte's, and no others'.
[[nodiscard]] std::string default_refiner(const graphs::NetworkChoice& saliency);

/// "slide_depth (built in)", "midas_v21 (midas.safetensors)"; "none".
[[nodiscard]] std::string describe(const graphs::NetworkChoice& choice);

}  // namespace slide
