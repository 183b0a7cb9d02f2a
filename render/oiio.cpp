#include "render/oiio.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "render/image_file.h"
#include "runtime/error.h"

#ifdef SLIDE_HAVE_OPENIMAGEIO
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/strutil.h>
#endif

namespace slide {

#ifdef SLIDE_HAVE_OPENIMAGEIO
namespace {

float srgb_from_linear(float v) {
  const float x = v > 0 ? std::min(v, 1.0F) : 0.0F;
  return x <= 0.0031308F ? 12.92F * x : 1.055F * std::pow(x, 1 / 2.4F) - 0.055F;
}

Exif exif_of(const OIIO::ImageSpec& spec) {
  const auto positive = [&spec](const char* name) -> std::optional<double> {
    const float v = spec.get_float_attribute(name, 0);
    if (std::isfinite(v) && v > 0) return v;
    return std::nullopt;
  };
  Exif exif;
  exif.orientation = spec.get_int_attribute("Orientation", 1);
  exif.focal_length_mm = positive("Exif:FocalLength");
  exif.focal_length_35mm = positive("Exif:FocalLengthIn35mmFilm");
  return exif;
}

[[noreturn]] void unreadable(const std::string& path, const std::string& why) {
  throw Error(ErrorKind::kBadInput, path + " cannot be read as an image: " + why,
              "JPEG, PNG and PFM are always read; others depend on OpenImageIO");
}

/// Formats that a photo or a map comes in. OpenImageIO knows more (volumes, film, raw), which are refused.
bool is_photo_format(std::string_view name) {
  static constexpr std::array<std::string_view, 9> kFormats = {"openexr", "tiff", "webp", "heif", "bmp",
                                                               "gif",     "hdr",  "pnm",  "targa"};
  return std::find(kFormats.begin(), kFormats.end(), name) != kFormats.end();
}

/// Refuses what is not one flat picture: read_image() would fill every slice of a volume.
void require_flat_photo(const OIIO::ImageInput& input, const std::string& path) {
  if (!is_photo_format(input.format_name()))
    unreadable(path, std::string("its format, ") + input.format_name() + ", is not one of photos");
  if (input.spec().depth > 1) unreadable(path, "it is a volume");
  if (input.spec().deep) unreadable(path, "it is a deep image");
}

}  // namespace

bool has_openimageio() noexcept { return true; }

Decoded read_through_openimageio(const std::string& path, bool photo, const SizeCheck& check) {
  OIIO::ImageSpec wanted;
  wanted["oiio:UnassociatedAlpha"] = 1;
  const auto input = OIIO::ImageInput::open(path, &wanted);
  if (!input) unreadable(path, OIIO::geterror());
  require_flat_photo(*input, path);
  const OIIO::ImageSpec& spec = input->spec();
  check_image_size(spec.width, spec.height, path);
  if (check) check(spec.width, spec.height);
  Decoded result;
  result.exif = exif_of(spec);
  const int channels = std::min(spec.nchannels, 4);
  result.image = Image(spec.width, spec.height, channels);
  if (!input->read_image(0, 0, 0, channels, OIIO::TypeDesc::FLOAT, result.image.data.data())) {
    unreadable(path, input->geterror());
  }
  if (photo && OIIO::Strutil::iequals(spec.get_string_attribute("oiio:ColorSpace"), "linear")) {
    const int colours = channels > 2 ? 3 : 1;
    for (std::size_t i = 0; i < result.image.data.size(); ++i) {
      float& v = result.image.data[i];
      if (static_cast<int>(i % static_cast<std::size_t>(channels)) < colours) v = srgb_from_linear(v);
    }
  }
  return result;
}

void write_exr_unsafely(const std::string& path, const Image& image) {
  const auto output = OIIO::ImageOutput::create("exr");
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::FLOAT);
  spec["compression"] = "zip";
  if (!output || !output->open(path, spec) ||
      !output->write_image(OIIO::TypeDesc::FLOAT, image.data.data()) || !output->close()) {
    throw Error(ErrorKind::kUsage,
                "cannot write " + path + ": " + (output ? output->geterror() : OIIO::geterror()));
  }
}

#else

namespace {
constexpr const char* kRemedy =
    "convert it to JPEG, PNG or (maps) PFM, or use a build configured with SLIDE_OPENIMAGEIO=ON";
}

bool has_openimageio() noexcept { return false; }

Decoded read_through_openimageio(const std::string& path, bool /*photo*/, const SizeCheck& /*check*/) {
  throw Error(ErrorKind::kBadInput, path + " is of a format this build does not read", kRemedy);
}

void write_exr_unsafely(const std::string& path, const Image&) {
  throw Error(ErrorKind::kUsage, "cannot write " + path + ": this build does not write OpenEXR",
              "write .pfm, or use a build configured with SLIDE_OPENIMAGEIO=ON");
}

#endif

}  // namespace slide
