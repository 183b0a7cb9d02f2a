#include "examples/slide_run/job.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "examples/slide_run/show_plan.h"
#include "render/camera_path.h"
#include "render/edge_zoom.h"
#include "render/export.h"
#include "render/frame_sink.h"
#include "render/photo_layers.h"
#include "render/training_masks.h"
#include "render/write_image.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/memory_limit.h"

namespace slide::run {
namespace {

namespace fs = std::filesystem;

/// A photo's name without folder and extension.
std::string name_of(const std::string& input) {
  return input == kStandardInput ? "photo" : fs::path(input).stem().string();
}

/// One photo's way, its parts in the order in which they run.
class Job {
 public:
  Job(const std::string& input, const std::vector<std::string>& outputs, const Options& options,
      Models& models, const Meter& meter, JobReport& report)
      : input_(input),
        outputs_(outputs),
        options_(options),
        models_(models),
        meter_(meter),
        report_(report) {}

  void read() {
    const Timer timer(*this, "reading");
    const bool own_depth = options_.depth == kDepthEmbedded || options_.depth == kDepthAuto;
    const Photo photo = read_input(own_depth ? EmbeddedMap::kRead : EmbeddedMap::kIgnored);
    report_.photo_width = photo.colour.width;
    report_.photo_height = photo.colour.height;
    const Image colour = shrink_to(photo.colour, options_.max_side);
    report_.width = colour.width;
    report_.height = colour.height;
    choose_camera(photo);
    tensors_.image = tensor_from_image(colour);
    take_depth(photo);
    if (options_.matte != "none" && options_.matte != "auto")
      tensors_.matte = matte_from_map(read_matte(options_.matte, size_check(options_.matte)), report_.width,
                                      report_.height, options_.matte);
    report_.matting_origin = describe(models_.choices().matting);
  }

  /// Refuses a photo or a map that does not even fit into the memory allowed, before it is decoded.
  void check_header(const std::string& file, int width, int height) const {
    constexpr std::size_t kBytesPerPixel = 3 * sizeof(float) + 3;  // colours, and as the file has them
    const std::size_t bytes =
        static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * kBytesPerPixel;
    if (bytes > memory_limit())
      throw Error(ErrorKind::kOutOfMemory,
                  file + " has " + std::to_string(width) + "x" + std::to_string(height) +
                      " pixels and needs " + std::to_string(bytes >> 20) + " MiB to be read, more than " +
                      limit_name(),
                  "make it smaller first");
  }

  [[nodiscard]] SizeCheck size_check(const std::string& file) const {
    return [this, file](int width, int height) { check_header(file, width, height); };
  }

  /// Refuses what needs more memory than allowed, before any work. What is left may hold prepared networks for
  /// the photos to come, if there are `many`.
  void check_memory(bool many) {
    report_.planned_memory = planned_memory(
        static_cast<std::size_t>(report_.photo_width) * static_cast<std::size_t>(report_.photo_height),
        report_.height, report_.width, models_.choices(), tensors_, slide_options());
    if (report_.planned_memory > memory_limit())
      throw Error(ErrorKind::kOutOfMemory,
                  input_ + ": " + std::to_string(report_.width) + "x" + std::to_string(report_.height) +
                      " pixels need " + std::to_string(report_.planned_memory >> 20) + " MiB, more than " +
                      limit_name(),
                  "a smaller --max-side needs less");
    models_.pipeline().keep(many ? memory_limit() - report_.planned_memory : 0);
  }

  void show_plan() const {
    print_plan(report_.height, report_.width, models_.choices(), tensors_, slide_options());
  }

  void make_layers() {
    made_ = models_.pipeline().make_layers(tensors_, slide_options());
    report_.planned_memory += models_.pipeline().kept_bytes();
    report_.slide = made_.report;
    for (const graphs::StageReport& stage : made_.report.stages) report_.stages.push_back(stage);
    layers_ = layers_from(made_);
    tensors_ = {};
  }

  /// Writes the maps and masks if they are asked for, and lets them go: what follows needs the two layers
  /// only.
  void write_side_outputs() {
    write_maps_and_masks();
    made_ = {};
  }

  void write(const std::string& output) {
    const Timer timer(*this, "writing " + output);
    const DrawnMeshes meshes = options_.stereo.empty()
                                   ? export_file(output, layers_, camera_, views_, export_options(output))
                                   : export_stereo(output, stereo_kind(options_.stereo), layers_, camera_,
                                                   eyes(output), export_options(output));
    if (meshes.triangles > 0) {
      report_.triangles = meshes.triangles;
      report_.full_mesh_triangles = meshes.full_triangles;
    }
    report_.outputs.push_back(output);
  }

 private:
  [[nodiscard]] std::size_t memory_limit() const {
    return options_.max_memory.empty() ? memory_of_process() : parse_bytes(options_.max_memory);
  }
  [[nodiscard]] std::string limit_name() const {
    return options_.max_memory.empty() ? "there is (" + std::to_string(memory_limit() >> 20) +
                                             " MiB; --max-memory sets another limit)"
                                       : "--max-memory " + options_.max_memory;
  }

  void write_maps_and_masks() {
    if (!options_.layers.empty()) {
      const Timer timer(*this, "writing layers");
      for (const std::string& file : write_maps(options_.layers, made_)) report_.outputs.push_back(file);
    }
    if (options_.dump_masks.empty()) return;
    const Timer timer(*this, "writing masks");
    std::error_code failure;
    fs::create_directories(options_.dump_masks, failure);
    const std::array<std::string, 2> files = mask_files(input_, options_);
    write_png(report_.outputs.emplace_back(files[0]), occlusion_mask(image_from_tensor(made_.occlusion)));
    write_png(report_.outputs.emplace_back(files[1]), stroke_mask(report_.width, report_.height, seed()));
  }

  /// Adds a stage to the report when it ends.
  class Timer {
   public:
    Timer(Job& job, std::string stage) : job_(job), stage_(std::move(stage)) { job_.meter_(stage_, 0); }
    ~Timer() {
      graphs::StageReport stage;
      stage.name = stage_;
      stage.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
      job_.report_.stages.push_back(stage);
    }
    Timer(const Timer&) = delete;
    Timer& operator=(const Timer&) = delete;

   private:
    Job& job_;
    std::string stage_;
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  };

  void choose_camera(const Photo& photo) {
    report_.fov = options_.fov.value_or(photo.horizontal_fov ? *photo.horizontal_fov * 180 / std::numbers::pi
                                                             : kDefaultFov);
    report_.fov_origin = options_.fov ? "--fov" : photo.horizontal_fov ? "EXIF" : "default";
    report_.fov = std::clamp(report_.fov, 1.0, 170.0);
    camera_ =
        make_camera(report_.width, report_.height, report_.fov, options_.near_depth, options_.far_depth);
    path_ = lower_extension(options_.path) == ".json"
                ? read_pose_file(options_.path)
                : make_path(camera_, path_options(path_kind(options_.path)));
    views_ = options_.stereo.empty() ? path_ : all_eyes();
    report_.parallax = largest_parallax(camera_, views_);
    report_.edge_zoom = options_.keep_edges ? 1 : edge_zoom(camera_, views_);
    check_coverage();
  }

  [[nodiscard]] Photo read_input(EmbeddedMap map) const {
    const SizeCheck check = size_check(input_);
    if (input_ != kStandardInput) return read_photo(input_, check, map);
    return decode_photo(read_standard_input(), "standard input", check, map);
  }

  /// The disparity that comes from a map: a file's or the photo's own.
  void take_depth(const Photo& photo) {
    const auto given = [this](const Image& map, DepthKind kind, const std::string& name) {
      tensors_.disparity = disparity_from_map(map, kind, report_.width, report_.height, name);
      report_.depth_origin = name;
      report_.depth_values = map.pixels();
      report_.depth_missing = missing_values(map, kind);
    };
    if (depth_is_file(options_)) {
      given(read_map(options_.depth, NonFinite::kKept, size_check(options_.depth)),
            depth_kind(options_.depth_kind), options_.depth);
    } else if (!photo.disparity.empty()) {
      given(photo.disparity, DepthKind::kDisparity, "the depth map in the photo");
    } else if (options_.depth == kDepthEmbedded) {
      throw Error(ErrorKind::kBadInput, input_ + " holds no depth map (GDepth or Dynamic Depth in a JPEG)",
                  "give one with --depth FILE, or leave --depth out and the network estimates it");
    } else {
      report_.depth_origin = describe(models_.choices().depth);
      report_.depth_left_alone = photo.has_depth;
    }
  }

  /// Refuses a path on which more than half of a frame would be empty.
  void check_coverage() {
    constexpr double kLeast = 0.5;
    report_.coverage = least_coverage(camera_, options_.keep_edges ? views_ : without_edges(camera_, views_));
    if (report_.coverage < kLeast)
      throw Error(ErrorKind::kUsage,
                  input_ + ": the camera leaves the photo: as little as " +
                      std::to_string(std::lround(100 * report_.coverage)) + " % of a frame would show it",
                  "a smaller --parallax, a --focus nearer to 0.5 or a smaller --fov keeps it in view");
  }

  /// The eyes that look at an output: of a still those of the photo's own camera, of a video those of each of
  /// the path's places, path and eyes with half of the parallax each.
  [[nodiscard]] std::vector<Eyes> eyes(const std::string& output) const {
    return is_still_output(output) ? eyes_of(camera_, {View()}, options_.parallax, options_.focus)
                                   : eyes_of(camera_, path_, options_.parallax / 2, options_.focus);
  }
  /// Every view of the outputs.
  [[nodiscard]] std::vector<View> all_eyes() const {
    std::vector<View> views;
    for (const std::string& output : outputs_)
      for (const Eyes& pair : eyes(output)) views.insert(views.end(), {pair.left, pair.right});
    return views;
  }

  [[nodiscard]] PathOptions path_options(PathKind kind) const {
    return {.kind = kind,
            .parallax_percent = options_.stereo.empty() ? options_.parallax : options_.parallax / 2,
            .focus = options_.focus,
            .frames = options_.frames};
  }

  [[nodiscard]] graphs::SlideOptions slide_options() const {
    graphs::SlideOptions o;
    o.layering = {.parallax = report_.parallax,
                  .beta = options_.beta,
                  .gamma = options_.gamma,
                  .rho = options_.rho,
                  .radius = options_.radius ? std::optional<std::int64_t>(*options_.radius) : std::nullopt,
                  .sigma = options_.sigma,
                  .maxpool = options_.maxpool};
    o.matte = options_.matte == "auto" ? graphs::MatteUse::kAuto : graphs::MatteUse::kNever;
    o.depth_edges = options_.depth_edges == "soft"    ? graphs::DepthEdges::kSoft
                    : options_.depth_edges == "sharp" ? graphs::DepthEdges::kSharp
                                                      : graphs::DepthEdges::kAuto;
    o.whole_image = options_.whole_image;
    const PrecisionChoice choice = precision_choice(options_.precision, options_.error_budget);
    o.precision = choice.precision;
    o.error_budget = choice.error_budget;
    o.progress = [this](const std::string& stage, double part, std::string_view) {
      meter_(stage, part);
      return true;
    };
    return o;
  }

  /// From the photo's name, so that each photo has strokes of its own, the same every time (FNV-1a).
  [[nodiscard]] std::uint64_t seed() const {
    std::uint64_t hash = 0xcbf29ce484222325U;
    for (const char c : name_of(input_)) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
    return hash;
  }

  [[nodiscard]] ExportOptions export_options(const std::string& output) const {
    const auto [width, height] =
        options_.size.empty() ? std::pair(0, 0) : parse_size(options_.size, report_.width, report_.height);
    return {.title = options_.title.empty() ? name_of(input_) : options_.title,
            .alt = options_.alt,
            .parallax_percent = options_.parallax,
            .focus = options_.focus,
            .width = width,
            .height = height,
            .fps = options_.fps,
            .mesh_tolerance = options_.mesh_tolerance,
            .supersample = options_.supersample,
            .glb_depth = options_.glb_depth == "true" ? GlbDepth::kTrue : GlbDepth::kRelief,
            .keep_edges = options_.keep_edges,
            .progress = [this, output](double part) { meter_("writing " + output, part); }};
  }

  const std::string& input_;
  const std::vector<std::string>& outputs_;
  const Options& options_;
  Models& models_;
  const Meter& meter_;
  JobReport& report_;
  Camera camera_;
  std::vector<View> path_;   ///< of the camera, between two eyes
  std::vector<View> views_;  ///< what is drawn: the path, or both eyes of all outputs
  graphs::SlideInput tensors_;
  graphs::SlideLayers made_;
  Layers layers_;
};

void require_known(const std::string& output, const Options& options) {
  if (options.stereo.empty()) return require_export_output(output);
  if (!is_still_output(output) && !is_frame_output(output))
    throw Error(ErrorKind::kUsage, "--stereo makes a picture or a video, " + output + " is none",
                "name it .png, .jpg, .mp4, .webm, .gif or .y4m");
}

}  // namespace

std::vector<std::string> output_names(const std::string& input, bool many, const Options& options) {
  const fs::path path(input);
  const std::string name = name_of(input);
  std::vector<std::string> names = options.outputs;
  if (names.empty()) {
    const char* suffix = options.stereo.empty() ? ".3d.html" : ".stereo.png";
    const fs::path beside = path.parent_path() / (name + suffix);
    return {beside.string()};
  }
  for (std::string& output : names) {
    const std::size_t at = output.find("{}");
    if (many && at == std::string::npos)
      throw Error(ErrorKind::kUsage, "several photos would all be written to " + output,
                  "put {} for the photo's name");
    if (at != std::string::npos) output.replace(at, 2, name);
    require_known(output, options);
  }
  return names;
}

std::array<std::string, 2> mask_files(const std::string& input, const Options& options) {
  const std::string stem = options.dump_masks + "/" + name_of(input);
  return {stem + ".occlusion.png", stem + ".strokes.png"};
}

void run_job(const std::string& input, bool many, const Options& options, Models& models, const Meter& meter,
             JobReport& report) {
  report.input = input;
  const std::vector<std::string> outputs = output_names(input, many, options);
  Job job(input, outputs, options, models, meter, report);
  job.read();
  if (options.plan) {
    job.show_plan();
    return;
  }
  job.check_memory(many);
  job.make_layers();
  job.write_side_outputs();
  for (const std::string& output : outputs) job.write(output);
}

}  // namespace slide::run
