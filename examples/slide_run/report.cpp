#include "examples/slide_run/report.h"

#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace slide::run {
namespace {

double mebibytes(std::size_t bytes) { return static_cast<double>(bytes) / 1048576; }

/// " (1.2 MB)" for a file, nothing for a folder or a pipe.
std::string file_size(const std::string& path) {
  std::error_code failure;
  if (!std::filesystem::is_regular_file(path, failure)) return "";
  const auto bytes = static_cast<double>(std::filesystem::file_size(path, failure));
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), bytes < 1e6 ? " (%.0f kB)" : " (%.1f MB)",
                bytes / (bytes < 1e6 ? 1e3 : 1e6));
  return failure ? "" : text.data();
}

/// What a network cost before its first layer.
std::string preparation(const graphs::StageReport& stage) {
  if (stage.reused) return "prepared for an earlier photo";
  return "prepared in " + std::to_string(std::lround(1e3 * stage.preparing)) + " ms";
}

void explain(const JobReport& r) {
  const graphs::SlideReport& s = r.slide;
  const graphs::Layering& l = s.layering;
  std::fprintf(stderr, "What was modelled, and what was skipped:\n");
  if (r.width != r.photo_width || r.height != r.photo_height)
    std::fprintf(stderr, "  size        %dx%d, reduced from %dx%d (--max-side)\n", r.width, r.height,
                 r.photo_width, r.photo_height);
  else
    std::fprintf(stderr, "  size        %dx%d\n", r.width, r.height);
  std::fprintf(
      stderr,
      "  camera      field of view %.2f degrees (%s); P = %.2f pixels; zoomed in by %.3f to hide the edge\n",
      r.fov, r.fov_origin.c_str(), r.parallax, r.edge_zoom);
  std::fprintf(stderr, "  depth       %s%s\n", r.depth_origin.c_str(),
               s.relief ? "" : "; no relief: one layer, nothing else is needed");
  if (s.depth_jump_pixels > 0)
    std::fprintf(stderr, "  edges       a jump of the map takes %.1f pixels: %s\n", s.depth_jump_pixels,
                 s.depth_sharpened ? "soft, brought onto the photo's" : "left as they are");
  std::fprintf(
      stderr, "  layering    beta %.4g, gamma %.4g, rho %.4g, radius %lld, sigma %.3g, maxpool %lld\n",
      l.beta, l.gamma, l.rho, static_cast<long long>(l.radius), l.sigma, static_cast<long long>(l.maxpool));
  std::fprintf(stderr, "  matte       %s%s%s (covers %.1f %%)\n", s.matte_used ? "used" : "not used",
               s.matte_refined ? (", refined by " + r.matting_origin).c_str() : "",
               s.matte_in_fill ? ", by the fill too" : "", 100 * s.matte_coverage);
  std::fprintf(stderr, "  background  %s; %.2f %% of the pixels may come into view\n", s.inpainting.c_str(),
               100 * s.hole_fraction);
  if (!s.windows.empty())
    std::fprintf(stderr, "  windows     %zu, %.1f %% of the image was computed; %s\n", s.windows.size(),
                 100 * s.window_fraction,
                 s.windows_exact ? "the result is that of the whole image"
                                 : "what lies outside would change the result a little (--whole-image)");
  if (r.triangles > 0)
    std::fprintf(stderr, "  meshes      %zu triangles (%.1f %% of the full meshes' %zu)\n", r.triangles,
                 100.0 * static_cast<double>(r.triangles) / static_cast<double>(r.full_mesh_triangles),
                 r.full_mesh_triangles);
  for (const graphs::StageReport& stage : r.stages)
    if (stage.gflop > 0)
      std::fprintf(stderr, "  %-11s predicted error %.2g; %d layers in bf16, %d in int8; %s\n",
                   stage.name.c_str(), stage.predicted_error, stage.bf16_layers, stage.int8_layers,
                   preparation(stage).c_str());
  std::fprintf(stderr, "  memory      %.0f MiB planned at most, %.0f MiB used at most\n",
               mebibytes(r.planned_memory), mebibytes(peak_memory()));
}

nlohmann::json to_json(const JobReport& r) {
  nlohmann::json stages = nlohmann::json::array();
  for (const graphs::StageReport& s : r.stages)
    stages.push_back({{"name", s.name},
                      {"seconds", s.seconds},
                      {"preparing_seconds", s.preparing},
                      {"reused", s.reused},
                      {"gflop", s.gflop},
                      {"memory_bytes", s.memory},
                      {"predicted_error", s.predicted_error},
                      {"bf16_layers", s.bf16_layers},
                      {"int8_layers", s.int8_layers}});
  nlohmann::json windows = nlohmann::json::array();
  for (const graphs::Window& w : r.slide.windows) windows.push_back({w.x0, w.y0, w.x1, w.y1});
  const graphs::Layering& l = r.slide.layering;
  nlohmann::json j = {{"input", r.input}, {"outputs", r.outputs}, {"exit_code", r.exit_code}};
  if (!r.error.empty()) j["error"] = r.error;
  j["photo"] = {
      {"width", r.photo_width}, {"height", r.photo_height}, {"fov", r.fov}, {"fov_origin", r.fov_origin}};
  j["worked_on"] = {{"width", r.width}, {"height", r.height}};
  j["parallax_pixels"] = r.parallax;
  j["edge_zoom"] = r.edge_zoom;
  j["coverage"] = r.coverage;
  j["layering"] = {{"beta", l.beta},     {"gamma", l.gamma}, {"rho", l.rho},
                   {"radius", l.radius}, {"sigma", l.sigma}, {"maxpool", l.maxpool}};
  j["depth"] = r.depth_origin;
  j["depth_missing"] = r.depth_missing;
  j["depth_jump_pixels"] = r.slide.depth_jump_pixels;
  j["depth_sharpened"] = r.slide.depth_sharpened;
  j["relief"] = r.slide.relief;
  j["matte"] = {{"used", r.slide.matte_used},
                {"in_fill", r.slide.matte_in_fill},
                {"coverage", r.slide.matte_coverage},
                {"refined_by", r.slide.matte_refined ? r.matting_origin : "none"}};
  j["inpainting"] = r.slide.inpainting;
  j["hole_fraction"] = r.slide.hole_fraction;
  j["windows"] = windows;
  j["window_fraction"] = r.slide.window_fraction;
  j["windows_exact"] = r.slide.windows_exact;
  j["triangles"] = r.triangles;
  j["full_mesh_triangles"] = r.full_mesh_triangles;
  j["planned_memory_bytes"] = r.planned_memory;
  j["stages"] = stages;
  return j;
}

}  // namespace

ProgressDisplay::ProgressDisplay(bool quiet) : quiet_(quiet), terminal_(isatty(STDERR_FILENO) != 0) {}

ProgressDisplay::~ProgressDisplay() { clear(); }

void ProgressDisplay::clear() {
  if (!quiet_ && terminal_ && percent_ >= 0) std::fprintf(stderr, "\r\033[K");
  percent_ = -1;
}

void ProgressDisplay::show(const std::string& stage, double part) {
  if (quiet_) return;
  const int percent = static_cast<int>(std::lround(100 * part));
  if (stage == stage_ && (!terminal_ || percent == percent_)) return;
  if (!terminal_ && stage != stage_) std::fprintf(stderr, "%s ...\n", stage.c_str());
  stage_ = stage;
  percent_ = percent;
  if (!terminal_) return;
  constexpr int kBar = 30;
  const int filled = std::min(kBar, kBar * percent / 100);
  std::fprintf(stderr, "\r\033[K[%s%s] %3d %%  %s",
               std::string(static_cast<std::size_t>(filled), '#').c_str(),
               std::string(static_cast<std::size_t>(kBar - filled), '.').c_str(), percent, stage.c_str());
  std::fflush(stderr);
}

void print_summary(const JobReport& r, bool explained) {
  std::fprintf(stderr, "%s: %dx%d pixels, depth from %s, %s background", r.input.c_str(), r.width, r.height,
               r.depth_origin.c_str(), r.slide.windows.empty() ? "no" : r.slide.inpainting.c_str());
  double total = 0;
  for (const graphs::StageReport& s : r.stages) total += s.seconds;
  std::fprintf(stderr, ", %.2f s\n", total);
  for (const graphs::StageReport& s : r.stages)
    if (s.gflop > 0)
      std::fprintf(stderr, "  %-28s %8.3f s  %8.2f GFLOP\n", s.name.c_str(), s.seconds, s.gflop);
    else
      std::fprintf(stderr, "  %-28s %8.3f s\n", s.name.c_str(), s.seconds);
  if (explained) explain(r);
  if (r.width != r.photo_width || r.height != r.photo_height)
    std::fprintf(stderr, "the photo was reduced from %dx%d (a larger --max-side keeps more of it)\n",
                 r.photo_width, r.photo_height);
  if (r.depth_missing > 0)
    std::fprintf(stderr, "%zu of %zu values of %s were missing; they were filled from around them\n",
                 r.depth_missing, r.depth_values, r.depth_origin.c_str());
  if (r.depth_left_alone)
    std::fprintf(stderr, "the photo holds a depth map of its own: --depth embedded uses it\n");
  if (r.coverage < 0.995)
    std::fprintf(
        stderr,
        "the photo's edge may show: up to %.0f %% of a frame is empty (less with a smaller --parallax)\n",
        100 * (1 - r.coverage));
  for (const std::string& output : r.outputs)
    std::fprintf(stderr, "wrote %s%s\n", output.c_str(), file_size(output).c_str());
}

void print_json(const std::vector<JobReport>& reports) {
  nlohmann::json all = nlohmann::json::array();
  for (const JobReport& r : reports) all.push_back(to_json(r));
  const nlohmann::json document = {{"photos", all}, {"peak_memory_bytes", peak_memory()}};
  std::printf("%s\n", document.dump(2, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
}

std::size_t peak_memory() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::size_t>(usage.ru_maxrss) * 1024;
}

}  // namespace slide::run
