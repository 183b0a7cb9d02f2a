#pragma once

#include <memory>
#include <string>

#include "examples/slide_run/options.h"
#include "graphs/slide.h"

namespace slide::run {

/// The networks of a run and the files they came from.
class Models {
 public:
  /// Opens the weights that the options name, else the ones inside the program. A network that the options do
  /// without (a depth map is given, no matte is asked for) is not loaded.
  /// @throws Error(kBadWeights) for files that cannot be read or belong to no network of the role,
  /// Error(kUsage)
  explicit Models(const Options& options);

  [[nodiscard]] const graphs::SlideModels& choices() const noexcept { return choices_; }
  /// "slide_depth (built in)", "midas_v21 (midas.safetensors)"; "none".
  [[nodiscard]] std::string describe(const graphs::NetworkChoice& choice) const;

 private:
  graphs::NetworkChoice open(const std::string& file, const std::string& model,
                             const std::string& default_model, const std::string& role);

  std::vector<std::unique_ptr<WeightSource>> sources_;
  graphs::SlideModels choices_;
};

}  // namespace slide::run
