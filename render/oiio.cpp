#include "render/oiio.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <memory>
#include <string_view>
#include <utility>

#include "render/image_file.h"
#include "render/write_image.h"
#include "runtime/error.h"

#ifdef SLIDE_HAVE_OPENIMAGEIO
#include <OpenImageIO/imageio.h>
#include <OpenImageIO/strutil.h>
#endif

namespace slide {

#ifdef SLIDE_HAVE_OPENIMAGEIO
namespace {

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

/// The file's ICC profile, or the straight line of linear light (OpenEXR, HDR).
std::optional<ColourProfile> profile_of(const OIIO::ImageSpec& spec) {
  if (OIIO::Strutil::iequals(spec.get_string_attribute("oiio:ColorSpace"), "linear")) return gamma_profile(1);
  const OIIO::ParamValue* icc = spec.find_attribute("ICCProfile");
  if (icc == nullptr || icc->type().basetype != OIIO::TypeDesc::UINT8) return std::nullopt;
  return read_icc_profile({static_cast<const std::uint8_t*>(icc->data()), icc->type().size()});
}

/// The channel Z of a file with several, as renderers write it beside the colours, alone or in a layer
/// ("View.Depth.Z").
std::optional<int> depth_channel(const OIIO::ImageSpec& spec) {
  for (int c = 0; c < spec.nchannels; ++c) {
    const std::string& name = spec.channelnames[static_cast<std::size_t>(c)];
    if (name == "Z" || name.ends_with(".Z")) return c;
  }
  return std::nullopt;
}

[[noreturn]] void unreadable(const std::string& path, const std::string& why) {
  throw Error(ErrorKind::kBadInput, path + " cannot be read as an image: " + why,
              "JPEG, PNG and PFM are always read; others depend on OpenImageIO");
}

/// The first bytes of a file, zeros behind its end.
using Head = std::array<unsigned char, 32>;

Head head_of(const std::string& path) {
  Head head{};
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(head.data()), head.size());
  return head;
}

bool has(const Head& head, std::size_t at, std::string_view text) {
  return std::equal(text.begin(), text.end(), head.begin() + static_cast<std::ptrdiff_t>(at),
                    [](char c, unsigned char byte) { return static_cast<unsigned char>(c) == byte; });
}

/// OpenImageIO's name of the format that a photo or a map comes in, by the first bytes; empty if it is none
/// of those. OpenImageIO itself would try every reader it has (volumes, film, raw), each a door.
std::string_view format_of(const Head& head, const std::string& path) {
  using namespace std::string_view_literals;
  if (has(head, 0, "\x76\x2F\x31\x01"sv)) return "openexr";
  for (const std::string_view magic : {"II*\0"sv, "MM\0*"sv, "II+\0"sv, "MM\0+"sv})
    if (has(head, 0, magic)) return "tiff";
  if (has(head, 0, "RIFF") && has(head, 8, "WEBP")) return "webp";
  if (has(head, 0, "GIF8")) return "gif";
  if (has(head, 0, "#?")) return "hdr";
  if (has(head, 0, "BM")) return "bmp";
  if (has(head, 0, "P") && head[1] >= '1' && head[1] <= '6') return "pnm";
  for (const std::string_view brand : {"heic", "heix", "heim", "heis", "mif1", "avif"})
    if (has(head, 4, "ftyp") && has(head, 8, brand)) return "heif";
  if (lower_extension(path) == ".tga") return "targa";  // has no magic number at its start
  return {};
}

unsigned little_endian(const Head& head, std::size_t at, std::size_t bytes) {
  unsigned value = 0;
  for (std::size_t i = bytes; i-- > 0;) value = value << 8U | head[at + i];
  return value;
}

/// The size in the header of a format whose reader allocates the picture when it opens the file; {0, 0} for
/// others. GIF89a section 18; RFC 9649 section 2.
std::pair<unsigned, unsigned> size_before_opening(const Head& head, std::string_view format) {
  if (format == "gif") return {little_endian(head, 6, 2), little_endian(head, 8, 2)};
  if (format != "webp") return {0, 0};
  if (has(head, 12, "VP8X")) return {little_endian(head, 24, 3) + 1, little_endian(head, 27, 3) + 1};
  if (has(head, 12, "VP8L")) {
    const unsigned bits = little_endian(head, 21, 4);
    return {(bits & 0x3FFFU) + 1, (bits >> 14U & 0x3FFFU) + 1};
  }
  return {little_endian(head, 26, 2) & 0x3FFFU, little_endian(head, 28, 2) & 0x3FFFU};
}

/// Refuses what is not one flat picture: read_image() would fill every slice of a volume.
void require_flat_photo(const OIIO::ImageInput& input, const std::string& path) {
  if (input.spec().depth > 1) unreadable(path, "it is a volume");
  if (input.spec().deep) unreadable(path, "it is a deep image");
}

/// Opens a file with the one reader that its first bytes ask for, once its size is known to be allowed.
std::unique_ptr<OIIO::ImageInput> open_photo(const std::string& path, const SizeCheck& check) {
  const Head head = head_of(path);
  const std::string_view format = format_of(head, path);
  if (format.empty()) unreadable(path, "it is of no format that photos or maps come in");
  if (const auto [width, height] = size_before_opening(head, format); width != 0 || height != 0) {
    check_image_size(width, height, path);
    if (check) check(static_cast<int>(width), static_cast<int>(height));
  }
  OIIO::ImageSpec wanted;
  wanted["oiio:UnassociatedAlpha"] = 1;
  OIIO::ImageSpec found;
  std::unique_ptr<OIIO::ImageInput> input = OIIO::ImageInput::create(std::string(format));
  if (!input) unreadable(path, OIIO::geterror());
  if (!input->open(path, found, wanted)) unreadable(path, input->geterror());
  require_flat_photo(*input, path);
  check_image_size(found.width, found.height, path);
  if (check) check(found.width, found.height);
  return input;
}

}  // namespace

bool has_openimageio() noexcept { return true; }

Decoded read_through_openimageio(const std::string& path, bool photo, const SizeCheck& check) {
  const std::unique_ptr<OIIO::ImageInput> input = open_photo(path, check);
  const OIIO::ImageSpec& spec = input->spec();
  Decoded result;
  result.exif = exif_of(spec);
  const std::optional<int> depth = photo ? std::nullopt : depth_channel(spec);
  const int first = depth.value_or(0);
  const int channels = depth ? 1 : std::min(spec.nchannels, 4);
  result.image = Image(spec.width, spec.height, channels);
  if (!input->read_image(0, 0, first, first + channels, OIIO::TypeDesc::FLOAT, result.image.data.data())) {
    unreadable(path, input->geterror());
  }
  if (photo) result.profile = profile_of(spec);
  return result;
}

void write_exr_unsafely(const std::string& path, const Image& image) {
  const auto output = OIIO::ImageOutput::create("exr");
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::FLOAT);
  spec["compression"] = "zip";
  spec["Software"] = "SLIDE";
  spec["DateTime"] = "1970:01:01 00:00:00";  // else the time of day, and no two runs give the same bytes
  if (!output || !output->open(path, spec) ||
      !output->write_image(OIIO::TypeDesc::FLOAT, image.data.data()) || !output->close()) {
    throw Error(ErrorKind::kOutput,
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
