#pragma once

#include "examples/network_files.h"
#include "examples/slide_run/options.h"

namespace slide::run {

/// The networks of a run.
class Models {
 public:
  /// Opens the weights that the options name, else the ones inside the program. A network that the options do
  /// without (a depth map is given, no matte is asked for) is not loaded. @throws as NetworkFiles::open()
  explicit Models(const Options& options);

  [[nodiscard]] const graphs::SlideModels& choices() const noexcept { return choices_; }

 private:
  NetworkFiles files_;
  graphs::SlideModels choices_;
};

}  // namespace slide::run
