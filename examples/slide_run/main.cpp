// slide_run: a photo becomes a 3D photo.

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "examples/cli_docs.h"
#include "examples/slide_run/job.h"
#include "examples/slide_run/report.h"
#include "examples/slide_run/show_plan.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/program.h"
#include "runtime/threads.h"
#include "runtime/version.h"

namespace slide::run {
namespace {

namespace fs = std::filesystem;

bool looks_like_photo(const fs::path& path) {
  static const char* const kExtensions[] = {".jpg",  ".jpeg", ".png", ".tif", ".tiff",
                                            ".webp", ".bmp",  ".exr", ".heic"};
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return std::find(std::begin(kExtensions), std::end(kExtensions), extension) != std::end(kExtensions);
}

/// Folders replaced by the photos in them, sorted by name.
std::vector<std::string> find_photos(const std::vector<std::string>& inputs) {
  std::vector<std::string> photos;
  for (const std::string& input : inputs) {
    if (!fs::is_directory(input)) {
      photos.push_back(input);
      continue;
    }
    std::vector<std::string> inside;
    for (const fs::directory_entry& entry : fs::directory_iterator(input))
      if (entry.is_regular_file() && looks_like_photo(entry.path())) inside.push_back(entry.path().string());
    std::sort(inside.begin(), inside.end());
    photos.insert(photos.end(), inside.begin(), inside.end());
  }
  return photos;
}

/// Whether two names are one file: the same file through links and hard links, or names that differ in case
/// only, which some file systems take for one.
bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  if (fs::equivalent(a, b, ignored)) return true;
  const auto folded = [](const fs::path& path) {
    std::error_code failed;
    std::string text = fs::weakly_canonical(fs::absolute(path), failed).string();
    if (failed) text = path.lexically_normal().string();
    std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
    return text;
  };
  return folded(a) == folded(b);
}

[[noreturn]] void refuse_output(const std::string& output, const std::string& input) {
  throw Error(ErrorKind::kUsage, "the output " + output + " would replace the input " + input,
              "give the output another name");
}

[[noreturn]] void refuse_folder(const std::string& folder, const std::string& input) {
  throw Error(ErrorKind::kUsage,
              "files in the folder " + folder + " might be replaced: the input " + input + " lies there",
              "name another folder");
}

/// Refuses outputs that would replace what is read, and two photos that would give one output.
void check_outputs(const Options& o, const std::vector<std::string>& photos) {
  std::vector<std::string> read = photos;
  for (const std::string* file : {&o.depth, &o.matte, &o.path, &o.depth_weights, &o.inpaint_weights,
                                  &o.saliency_weights, &o.matting_weights})
    if (std::error_code ignored; !file->empty() && fs::exists(*file, ignored)) read.push_back(*file);
  std::vector<std::string> folders, written;
  for (const std::string& folder : {o.layers, o.dump_masks})
    if (!folder.empty()) folders.push_back(folder);
  for (const std::string& photo : photos) {
    for (const std::string& output : output_names(photo, photos.size() > 1, o)) {
      if (output == "-") continue;
      if (output.ends_with('/')) folders.push_back(output);
      for (const std::string& input : read)
        if (same_file(output, input)) refuse_output(output, input);
      for (const std::string& other : written)
        if (same_file(output, other))
          throw Error(ErrorKind::kUsage, "two outputs would be " + output,
                      "rename one of the photos, or give the outputs different names");
      written.push_back(output);
    }
  }
  for (const std::string& folder : folders)
    for (const std::string& input : read)
      if (same_file(folder, fs::absolute(input).parent_path())) refuse_folder(folder, input);
}

void check_combinations(const Options& o, const std::vector<std::string>& photos) {
  if (photos.empty())
    throw Error(ErrorKind::kUsage, "no photo was given", "slide_run photo.jpg, or slide_run --help");
  const bool many = photos.size() > 1;
  if (many && !o.depth.empty())
    throw Error(ErrorKind::kUsage,
                "--depth belongs to one photo, and there are " + std::to_string(photos.size()));
  if (many && o.matte != "none" && o.matte != "auto")
    throw Error(ErrorKind::kUsage,
                "--matte FILE belongs to one photo, and there are " + std::to_string(photos.size()));
  if (many && !o.layers.empty())
    throw Error(ErrorKind::kUsage,
                "--layers belongs to one photo, and there are " + std::to_string(photos.size()));
  if (o.inpaint_model == kFillAlone && !o.inpaint_weights.empty())
    throw Error(ErrorKind::kUsage, "--inpaint-model fill has no weights, and --inpaint-weights gives some",
                "leave one of them out");
  check_outputs(o, photos);
  (void)parse_size(o.size, 640, 480);
  if (!o.max_memory.empty()) (void)parse_bytes(o.max_memory);
  (void)precision_choice(o.precision, o.error_budget);
}

/// Runs every photo; one that fails does not stop the others. @return the exit code
int run_all(const Options& o, const std::vector<std::string>& photos) {
  const Models models(o);
  ProgressDisplay progress(o.quiet || o.json);
  const Meter meter = [&](const std::string& stage, double part) { progress.show(stage, part); };
  std::vector<JobReport> reports(photos.size());
  int failures = 0;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    JobReport& report = reports[i];
    try {
      run_job(photos[i], photos.size() > 1, o, models, meter, report);
    } catch (...) {  // whatever it is, the other photos are done
      const Failure failure = current_failure();
      report.error = failure.message.find(photos[i]) == std::string::npos ? photos[i] + ": " + failure.message
                                                                          : failure.message;
      report.exit_code = exit_code(failure.kind);
    }
    progress.clear();
    failures += report.error.empty() ? 0 : 1;
    if (!report.error.empty())
      std::fprintf(stderr, "slide_run: %s\n", report.error.c_str());
    else if (!o.quiet && !o.json && !o.plan)
      print_summary(report, o.explain);
  }
  if (o.json) print_json(reports);
  if (photos.size() > 1 && !o.quiet && !o.json)
    std::fprintf(stderr, "%zu photos, %zu done, %d failed\n", photos.size(),
                 photos.size() - static_cast<std::size_t>(failures), failures);
  if (photos.size() == 1) return reports[0].exit_code;
  return failures == 0 ? 0 : 1;
}

void say_what_next(const Options& o, std::size_t photos) {
  if (o.quiet || o.json || o.plan || photos != 1 || !o.outputs.empty()) return;
  std::fprintf(stderr,
               "Open it in a browser and move the mouse. Next: -o photo.gif for an animation, --explain for "
               "the details.\n");
}

int parse_and_run(int argc, char** argv) {
  Options o;
  CLI::App app;
  declare(app, o);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    const int code = app.exit(e);
    return code == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  if (o.man || o.completion) {
    const std::string page = o.man ? man_page(app, "slide_run", "SLIDE " + std::string(version()))
                                   : bash_completion(app, "slide_run");
    std::fputs(page.c_str(), stdout);
    return 0;
  }
  set_thread_count(o.threads);
  if (!o.isa.empty()) set_isa(isa_from_text(o.isa, "--isa"));
  const std::vector<std::string> photos = find_photos(o.inputs);
  check_combinations(o, photos);
  const int code = run_all(o, photos);
  if (code == 0) say_what_next(o, photos.size());
  return code;
}

}  // namespace
}  // namespace slide::run

int main(int argc, char** argv) {
  (void)slide::run::resident_at_start();
  return slide::run_program("slide_run", [&] { return slide::run::parse_and_run(argc, argv); });
}
