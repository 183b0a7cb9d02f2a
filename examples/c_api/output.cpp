// 3D photos as files, and as bytes.

#include <stdlib.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>

#include "examples/c_api/internal.h"
#include "render/camera_path.h"
#include "render/export.h"
#include "render/gltf.h"
#include "render/html.h"
#include "render/own_output.h"
#include "render/ply.h"
#include "render/write_image.h"
#include "runtime/atomic_file.h"
#include "runtime/thread_scope.h"

using namespace slide::c_api;

namespace {

using slide::Error;
using slide::ErrorKind;
namespace fs = std::filesystem;

slide_output default_output() {
  slide_output o{};
  o.struct_size = sizeof o;
  return o;
}

slide::ExportOptions export_options(const slide_photo& photo, const slide_output& o) {
  require((o.width == 0) == (o.height == 0) && o.width >= 0 && o.height >= 0,
          "width and height of an output go together");
  slide::ExportOptions options;
  if (o.title != nullptr) options.title = o.title;
  options.alt = text(o.alt);
  options.parallax_percent = photo.parallax_percent;
  options.focus = photo.focus;
  options.width = o.width;
  options.height = o.height;
  if (o.fps != 0) options.fps = o.fps;
  options.supersample = o.supersample != 0;
  if (o.progress != nullptr)
    options.progress = [progress = o.progress, user = o.user](double part) {
      if (progress(user, "writing", part) == 0)
        throw Error(ErrorKind::kCancelled, "cancelled while frames were written");
    };
  return options;
}

/// A folder of its own for temporary files, removed with what it holds.
class TemporaryFolder {
 public:
  TemporaryFolder() : path_((fs::temp_directory_path() / "slide-XXXXXX").string()) {
    if (::mkdtemp(path_.data()) == nullptr)
      throw Error(ErrorKind::kOutput, "no folder can be made in " + fs::temp_directory_path().string(),
                  "set TMPDIR to a folder that can be written");
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] std::string file(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

/// Where slide_encode() puts bytes.
struct Writer {
  slide_write write;
  void* user;
  void operator()(const void* bytes, std::size_t size) const {
    if (write(user, bytes, size) == 0)
      throw Error(ErrorKind::kOutput, "the function that takes the output's bytes gave up");
  }
};

void copy_file(const std::string& path, const Writer& writer) {
  std::ifstream file(path, std::ios::binary);
  std::array<char, 65536> part{};
  while (file.read(part.data(), part.size()) || file.gcount() > 0)
    writer(part.data(), static_cast<std::size_t>(file.gcount()));
  if (!file.eof()) throw Error(ErrorKind::kOutput, path + " cannot be read back");
}

/// @param name  of a file as export_file() would be given it
void encode(const slide_photo& photo, const std::string& name, const slide::ExportOptions& options,
            const Writer& writer) {
  const std::string extension = slide::lower_extension(name);
  if (slide::is_page_output(name)) {
    const std::string page = slide::encode_html(photo.layers, photo.camera,
                                                {.title = options.title,
                                                 .alt = options.alt,
                                                 .parallax_percent = options.parallax_percent,
                                                 .focus = options.focus});
    return writer(page.data(), page.size());
  }
  if (extension == ".glb") {
    const std::vector<std::uint8_t> model =
        slide::encode_glb(photo.layers, photo.camera,
                          {.parallax = slide::largest_parallax(photo.camera, photo.views),
                           .depth = options.glb_depth,
                           .focus = options.focus});
    return writer(model.data(), model.size());
  }
  if (extension == ".ply") {
    const std::vector<std::uint8_t> points = slide::encode_ply(photo.layers, photo.camera);
    return writer(points.data(), points.size());
  }
  const TemporaryFolder folder;
  const std::string file = folder.file(name);
  (void)slide::export_file(file, photo.layers, photo.camera, photo.views, options);
  copy_file(file, writer);
}

}  // namespace

void slide_output_init(slide_output* output, size_t size) { fill_defaults(output, size, default_output()); }

slide_status slide_export(const slide_photo* photo, const char* path, const slide_output* output) {
  return guarded([&] {
    require(photo != nullptr && path != nullptr, "photo or path is NULL");
    const slide_output o = completed(output, default_output(), "slide_output_init");
    require(!slide::same_file(path, photo->source), "the photo itself would be replaced");
    if (o.overwrite == 0) slide::require_replaceable(path);
    const slide::ThreadScope threads(photo->threads);
    (void)slide::export_file(path, photo->layers, photo->camera, photo->views, export_options(*photo, o));
  });
}

slide_status slide_encode(const slide_photo* photo, const char* format, const slide_output* output,
                          slide_write write, void* write_user) {
  return guarded([&] {
    require(photo != nullptr && format != nullptr && write != nullptr, "photo, format or write is NULL");
    const slide_output o = completed(output, default_output(), "slide_output_init");
    const std::string extension = format[0] == '.' ? format : "." + std::string(format);
    require(extension.find('/') == std::string::npos && extension.size() > 1,
            "the format is no extension, as html or gif");
    const std::string name = "x" + slide::lower_extension("x" + extension);
    slide::require_export_output(name);
    const slide::ThreadScope threads(photo->threads);
    encode(*photo, name, export_options(*photo, o), {write, write_user});
  });
}
