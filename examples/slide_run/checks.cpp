#include "examples/slide_run/checks.h"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "examples/slide_run/job.h"
#include "render/export.h"
#include "render/frame_sink.h"
#include "render/own_output.h"
#include "render/photo_layers.h"
#include "render/write_image.h"
#include "runtime/error.h"
#include "runtime/error_model.h"

namespace slide::run {
namespace {

namespace fs = std::filesystem;

bool looks_like_photo(const fs::path& path) {
  static const char* const kExtensions[] = {".jpg",  ".jpeg", ".jfif", ".png",  ".tif",  ".tiff",
                                            ".webp", ".bmp",  ".exr",  ".heic", ".heif", ".avif"};
  if (path.filename().string().starts_with("._")) return false;  // macOS's notes about the file of that name
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return std::find(std::begin(kExtensions), std::end(kExtensions), extension) != std::end(kExtensions);
}

/// Whether a folder's entry is tried as a photo: files, and links that lead to none.
bool is_tried(const fs::directory_entry& entry) {
  std::error_code code;
  const fs::file_type type = entry.status(code).type();
  return looks_like_photo(entry.path()) && type != fs::file_type::directory &&
         (code || type == fs::file_type::regular || type == fs::file_type::not_found);
}

/// What a path is known by: its spelling with links followed and case ignored, which some file systems ignore
/// too; and, where there is a file, the file itself, whatever links lead to it.
std::vector<std::string> keys_of(const fs::path& path) {
  std::error_code failed;
  std::string text = fs::weakly_canonical(fs::absolute(path, failed), failed).string();
  if (failed) text = path.lexically_normal().string();
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  std::vector<std::string> keys = {text};
  struct stat status {};
  if (::stat(path.c_str(), &status) == 0)
    keys.push_back(std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino));
  return keys;
}

/// Files by what they are known by.
class KnownFiles {
 public:
  void add(const std::string& path) {
    for (const std::string& key : keys_of(path)) files_.emplace(key, path);
  }
  /// The name under which the file was added; nullptr if it was not.
  [[nodiscard]] const std::string* find(const std::string& path) const {
    for (const std::string& key : keys_of(path))
      if (const auto at = files_.find(key); at != files_.end()) return &at->second;
    return nullptr;
  }

 private:
  std::map<std::string, std::string> files_;
};

KnownFiles files_read(const Options& o, const std::vector<std::string>& photos) {
  KnownFiles read;
  for (const std::string& photo : photos) read.add(photo);
  for (const std::string* file : {&o.depth, &o.matte, &o.path, &o.depth_weights, &o.inpaint_weights,
                                  &o.saliency_weights, &o.matting_weights})
    if (std::error_code ignored; !file->empty() && fs::exists(*file, ignored)) read.add(*file);
  return read;
}

/// Every file and folder of frames that one photo becomes.
std::vector<std::string> written_for(const std::string& photo, bool many, const Options& o) {
  std::vector<std::string> files = output_names(photo, many, o);
  if (!o.dump_masks.empty())
    for (const std::string& mask : mask_files(photo, o)) files.push_back(mask);
  if (!o.layers.empty())
    for (const std::string& map : map_files(o.layers)) files.push_back(map);
  return files;
}

void refuse_input(const std::string& output, const std::string& input) {
  throw Error(ErrorKind::kUsage, "the output " + output + " would replace the input " + input,
              "give the output another name");
}

/// Refuses a folder of frames in which an input has a frame's name.
void check_folder(const std::string& folder, const KnownFiles& read) {
  std::error_code code;
  for (fs::directory_iterator entry(folder, code), end; !code && entry != end; entry.increment(code))
    if (entry->path().filename().string().starts_with("frame_"))
      if (const std::string* input = read.find(entry->path().string())) refuse_input(folder, *input);
}

/// Refuses outputs that would replace what is read, another output, or what this program has not made.
void check_outputs(const Options& o, const std::vector<std::string>& photos) {
  const KnownFiles read = files_read(o, photos);
  KnownFiles written;
  for (const std::string& photo : photos)
    for (const std::string& output : written_for(photo, photos.size() > 1, o)) {
      if (output == "-") continue;
      if (const std::string* input = read.find(output)) refuse_input(output, *input);
      check_folder(output, read);
      if (written.find(output) != nullptr)
        throw Error(ErrorKind::kUsage, "two outputs would be " + output,
                    "rename one of the photos, or give the outputs different names");
      written.add(output);
      if (!o.overwrite) require_replaceable(output);
    }
}

/// Options that go with one photo only.
void check_count(const Options& o, std::size_t photos) {
  if (photos == 0)
    throw Error(ErrorKind::kUsage, "no photo was given", "slide_run photo.jpg, or slide_run --help");
  if (photos == 1) return;
  const auto refuse = [&](const char* option) {
    throw Error(ErrorKind::kUsage,
                std::string(option) + " belongs to one photo, and there are " + std::to_string(photos));
  };
  if (depth_is_file(o)) refuse("--depth FILE");
  if (o.matte != "none" && o.matte != "auto") refuse("--matte FILE");
  if (!o.layers.empty()) refuse("--layers");
  if (!o.title.empty()) refuse("--title");
  if (!o.alt.empty()) refuse("--alt");
}

/// What lies in no folder needs a name for what it becomes.
void check_standard_input(const Options& o, const std::vector<std::string>& photos) {
  if (o.outputs.empty() && !o.plan && std::find(photos.begin(), photos.end(), kStandardInput) != photos.end())
    throw Error(ErrorKind::kUsage, "a photo from standard input has no place for its 3D photo",
                "name it with -o");
}

/// Whether any output is made of frames, or is a still.
bool draws(const Options& o) {
  if (!o.stereo.empty()) return true;
  return std::any_of(o.outputs.begin(), o.outputs.end(), is_frame_output);
}

/// Whether any output is a page.
bool makes_page(const Options& o) {
  return o.outputs.empty() ? o.stereo.empty()
                           : std::any_of(o.outputs.begin(), o.outputs.end(), is_page_output);
}

/// Whether any output has that extension.
bool makes(const Options& o, std::string_view extension) {
  return std::any_of(o.outputs.begin(), o.outputs.end(),
                     [&](const std::string& output) { return lower_extension(output) == extension; });
}

/// Whether any stage is a network's.
bool runs_network(const Options& o) {
  return !depth_is_file(o) || o.matte == "auto" || o.inpaint_model != kFillAlone;
}

/// Whether the camera moves in any output: in all but stills for two eyes.
bool moves(const Options& o) {
  return o.stereo.empty() || std::any_of(o.outputs.begin(), o.outputs.end(),
                                         [](const std::string& output) { return !is_still_output(output); });
}

/// Refuses options that would do nothing, which is never what was meant. Those that depend on another option
/// alone are refused by the parser.
void check_idle(const CLI::App& app, const Options& o) {
  const auto refuse = [&](const char* option, const std::string& why) {
    if (app.count(option) > 0)
      throw Error(ErrorKind::kUsage, std::string(option) + " does nothing here: " + why, "leave it out");
  };
  if (o.matte != "auto")
    for (const char* option :
         {"--saliency-weights", "--saliency-model", "--matting-weights", "--matting-model"})
      refuse(option, "it is for --matte auto");
  if (!o.depth.empty() && o.depth != kDepthAuto)
    for (const char* option : {"--depth-weights", "--depth-model", "--depth-size"})
      refuse(option, "--depth " + o.depth + " takes the network's place");
  if (!depth_is_file(o)) refuse("--depth-kind", "it is for --depth FILE");
  if (o.inpaint_model == kFillAlone) refuse("--inpaint-weights", "--inpaint-model fill has none");
  if (o.matting_model == kMatteAsItIs) refuse("--matting-weights", "--matting-model none has none");
  if (!makes_page(o))
    for (const char* option : {"--title", "--alt"}) refuse(option, "no output is a page (.html)");
  if (!moves(o))
    for (const char* option : {"--path", "--frames", "--fps"}) refuse(option, "a stereo still does not move");
  if (!draws(o))
    for (const char* option : {"--fps", "--size", "--keep-edges", "--supersample", "--mesh-tolerance"})
      refuse(option, "no output is made of frames");
  if (!makes(o, ".glb")) refuse("--glb-depth", "no output is a .glb");
  if (lower_extension(o.path) == ".json") {
    refuse("--frames", "the file of poses has as many as it has");
    if (!makes_page(o))
      for (const char* option : {"--parallax", "--focus"})
        refuse(option, "the file of poses says where to look");
  }
  if (!runs_network(o))
    for (const char* option : {"--precision", "--error-budget"}) refuse(option, "no network runs");
  if (o.quiet || o.json || o.plan)
    refuse("--explain", o.quiet  ? "--quiet prints nothing"
                        : o.json ? "--json says it all"
                                 : "--plan stops before");
}

}  // namespace

std::vector<std::string> find_photos(const std::vector<std::string>& inputs) {
  std::vector<std::string> photos;
  for (const std::string& input : inputs) {
    std::error_code code;
    fs::directory_iterator entry(input, code);
    if (code) {  // no folder, or one that cannot be read: reading it as a photo tells which
      photos.push_back(input);
      continue;
    }
    std::vector<std::string> inside;
    for (const fs::directory_iterator end; !code && entry != end; entry.increment(code))
      if (is_tried(*entry)) inside.push_back(entry->path().string());
    std::sort(inside.begin(), inside.end());
    photos.insert(photos.end(), inside.begin(), inside.end());
  }
  return photos;
}

void check_call(const CLI::App& app, const Options& o, const std::vector<std::string>& photos) {
  check_count(o, photos.size());
  check_standard_input(o, photos);
  check_idle(app, o);
  check_outputs(o, photos);
  (void)parse_size(o.size, 640, 480);
  if (!o.max_memory.empty()) (void)parse_bytes(o.max_memory);
  (void)precision_choice(o.precision, o.error_budget);
}

}  // namespace slide::run
