#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>

#include "graphs/slide.h"

namespace slide::graphs {

class PreparedStages;

/// The networks of a 3D photo, run for photo after photo or frame after frame. What a network is prepared
/// with (its fused graph, plan, packed weights) is kept and used again for images of the same size, and
/// results lie in one piece of memory. A photo gives the same bytes as with make_layers().
///
/// One call at a time; several pipelines may run at once, on weights in common. Throws as make_layers().
class Pipeline {
 public:
  static constexpr std::size_t kKeepAll = std::numeric_limits<std::size_t>::max();

  /// @param models  their weights must outlive the pipeline
  /// @param keep    bytes of packed weights that may be kept between photos; 0: none, as make_layers() does
  explicit Pipeline(const SlideModels& models, std::size_t keep = kKeepAll);
  ~Pipeline();
  Pipeline(Pipeline&&) noexcept;
  Pipeline& operator=(Pipeline&&) noexcept;

  [[nodiscard]] const SlideModels& models() const noexcept { return models_; }
  /// Changes what may be kept. What was used longest ago goes first.
  void keep(std::size_t bytes);
  /// Bytes of the packed weights that are kept now.
  [[nodiscard]] std::size_t kept_bytes() const noexcept;
  /// Gives back the memory for results until the next call, packed weights not.
  void release_workspace() noexcept;

  /// The layers of a photo. The memory for results is given back.
  [[nodiscard]] SlideLayers make_layers(const SlideInput& input, const SlideOptions& options);

  /// D of a photo 1×3×H×W in [0, 1] alone: 1×1×H×W in [0, 1], 1 is nearest. The memory for results stays.
  /// @param report  what it took, if not null
  [[nodiscard]] Tensor disparity(const Tensor& image, const SlideOptions& options,
                                 StageReport* report = nullptr);
  /// What the first disparity() of that size would have to prepare.
  void prepare_disparity(std::int64_t height, std::int64_t width, const SlideOptions& options);

 private:
  SlideModels models_;
  std::unique_ptr<PreparedStages> prepared_;
};

}  // namespace slide::graphs
