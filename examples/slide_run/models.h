#pragma once

#include "examples/network_files.h"
#include "examples/slide_run/options.h"
#include "graphs/pipeline.h"

namespace slide::run {

/// The networks of a run, prepared once for all its photos.
class Models {
 public:
  /// Opens the weights that the options name, else the ones inside the program. A network that the options do
  /// without (a depth map is given, no matte is asked for) is not loaded. @throws as NetworkFiles::open()
  explicit Models(const Options& options);

  [[nodiscard]] const graphs::SlideModels& choices() const noexcept { return pipeline_.models(); }
  [[nodiscard]] graphs::Pipeline& pipeline() noexcept { return pipeline_; }

 private:
  NetworkFiles files_;
  graphs::Pipeline pipeline_;
};

}  // namespace slide::run
