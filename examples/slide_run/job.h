#pragma once

#include <array>
#include <string>
#include <vector>

#include "examples/slide_run/models.h"
#include "examples/slide_run/options.h"
#include "graphs/slide.h"
#include "render/image_file.h"

namespace slide::run {

/// What one photo became.
struct JobReport {
  std::string input;
  std::string error;                      ///< empty: done
  int exit_code = 0;                      ///< of the error
  int photo_width = 0, photo_height = 0;  ///< as in the file
  int width = 0, height = 0;              ///< as worked on
  double fov = 0;                         ///< degrees
  std::string fov_origin;                 ///< "--fov", "EXIF", "default"
  double parallax = 0;                    ///< P, pixels
  double edge_zoom = 1;
  double coverage = 1;  ///< least_coverage() of the frames
  graphs::SlideReport slide;
  std::string depth_origin;
  std::size_t depth_values = 0;   ///< of the depth map
  std::size_t depth_missing = 0;  ///< of those, filled from around them
  bool depth_left_alone = false;  ///< the photo's file holds a depth map that was not used
  std::string matting_origin;
  std::vector<graphs::StageReport> stages;  ///< reading to writing, the networks in between
  std::size_t triangles = 0;
  std::size_t full_mesh_triangles = 0;
  std::size_t planned_memory = 0;  ///< bytes
  std::vector<std::string> outputs;
};

/// The photo that is read from standard input.
inline constexpr const char* kStandardInput = "-";

/// Receives how far a job is: the stage, and 0 to 1.
using Meter = std::function<void(const std::string& stage, double part)>;

/// Makes everything that the options ask for of one photo. `many`: other photos come after it, so outputs
/// need "{}".
/// @throws Error of any kind; what was finished before it stays in `report`
void run_job(const std::string& input, bool many, const Options& options, Models& models, const Meter& meter,
             JobReport& report);

/// Where --dump-masks writes the occlusion mask and the strokes of one photo.
[[nodiscard]] std::array<std::string, 2> mask_files(const std::string& input, const Options& options);

/// The outputs' names for one photo: "{}" replaced by its name without extension ("photo" for standard
/// input), the default if there are none.
/// @throws Error(kUsage) if two photos would write one file, or an extension is unknown
[[nodiscard]] std::vector<std::string> output_names(const std::string& input, bool many,
                                                    const Options& options);

}  // namespace slide::run
