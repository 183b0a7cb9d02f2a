#include <png.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <utility>

#include "render/codec.h"
#include "render/image_file.h"
#include "runtime/error.h"

// As in jpeg.cpp: libpng leaves by longjmp, so functions that call setjmp hold only plain data.

namespace slide {
namespace {

constexpr png_alloc_size_t kMaxChunkBytes = 8'000'000;  // of EXIF or a profile

struct Message {
  std::array<char, 200> text{};
};

[[noreturn]] void leave_with_message(png_structp png, png_const_charp text) {
  auto* message = static_cast<Message*>(png_get_error_ptr(png));
  std::strncpy(message->text.data(), text, message->text.size() - 1);
  png_longjmp(png, 1);
}

void ignore_warning(png_structp, png_const_charp) {}

struct Reader {
  Message message;
  png_structp png = nullptr;
  png_infop info = nullptr;
  const std::uint8_t* next = nullptr;
  std::size_t left = 0;

  explicit Reader(std::span<const std::uint8_t> bytes) : next(bytes.data()), left(bytes.size()) {
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, leave_with_message, ignore_warning);
    if (png != nullptr) info = png_create_info_struct(png);
  }
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
};

void take_bytes(png_structp png, png_bytep out, std::size_t count) {
  auto* r = static_cast<Reader*>(png_get_io_ptr(png));
  if (count > r->left) png_error(png, "the file ends too early");
  std::memcpy(out, r->next, count);
  r->next += count;
  r->left -= count;
}

bool read_header(Reader& r) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  // Sizes are checked by check_image_size, whose message says what the limit is.
  png_set_user_limits(r.png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
  // Texts mean nothing here, and one of a few bytes can claim gigabytes.
  constexpr std::array<png_byte, 15> kTexts = {'t', 'E', 'X', 't', 0,   'z', 'T', 'X',
                                               't', 0,   'i', 'T', 'X', 't', 0};
  png_set_keep_unknown_chunks(r.png, PNG_HANDLE_CHUNK_NEVER, kTexts.data(), 3);
  png_set_chunk_malloc_max(r.png, kMaxChunkBytes);
  png_set_read_fn(r.png, &r, take_bytes);
  png_read_info(r.png, r.info);
  return true;
}

/// The colour profile: sRGB's own chunk says that there is none to apply, an ICC profile goes before a gamma
/// (PNG third edition, section 4.3).
std::optional<ColourProfile> profile_of(Reader& r) {
  if (png_get_valid(r.png, r.info, PNG_INFO_sRGB) != 0) return std::nullopt;
  png_charp name = nullptr;
  png_bytep data = nullptr;
  png_uint_32 size = 0;
  int compression = 0;
  if (png_get_iCCP(r.png, r.info, &name, &compression, &data, &size) != 0)
    return read_icc_profile({data, size});
  double exponent = 0;
  if (png_get_gAMA(r.png, r.info, &exponent) != 0) return gamma_profile(exponent);
  return std::nullopt;
}

/// Asks for 8 or 16 bits a sample, no palette, transparency as a channel.
bool prepare(Reader& r) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  png_set_expand(r.png);
  png_set_interlace_handling(r.png);
  png_read_update_info(r.png, r.info);
  return true;
}

bool read_samples(Reader& r, png_bytepp rows) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  png_read_image(r.png, rows);
  png_read_end(r.png, r.info);
  return true;
}

[[noreturn]] void damaged(const Reader& r, const std::string& name) {
  throw Error(ErrorKind::kBadInput, name + " is a damaged PNG file: " + r.message.text.data(),
              "copy or download it again, or open and save it in an image editor");
}

void samples_to_floats(const std::vector<png_byte>& samples, bool wide, std::vector<float>& out) {
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = wide ? static_cast<float>(samples[2 * i] * 256 + samples[2 * i + 1]) / 65535.0F
                  : static_cast<float>(samples[i]) / 255.0F;
  }
}

struct Writer {
  Message message;
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::vector<std::uint8_t> bytes;

  Writer() {
    png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &message, leave_with_message, ignore_warning);
    if (png != nullptr) info = png_create_info_struct(png);
  }
  ~Writer() { png_destroy_write_struct(&png, &info); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
};

void append_bytes(png_structp png, png_bytep data, std::size_t count) {
  auto* w = static_cast<Writer*>(png_get_io_ptr(png));
  try {
    w->bytes.insert(w->bytes.end(), data, data + count);
    return;
  } catch (const std::bad_alloc&) {
    // Reported below, once the exception is gone.
  }
  png_error(png, "out of memory");
}

bool write_samples(Writer& w, int width, int height, int bits, int colour_type, png_bytepp rows) {
  if (setjmp(png_jmpbuf(w.png)) != 0) return false;
  png_set_write_fn(w.png, &w, append_bytes, nullptr);
  png_set_IHDR(w.png, w.info, static_cast<png_uint_32>(width), static_cast<png_uint_32>(height), bits,
               colour_type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_compression_level(w.png, 6);
  std::array<char, 9> key = {"Software"};
  std::array<char, 6> mark = {"SLIDE"};  // by which require_replaceable() knows it
  png_text text{};
  text.compression = PNG_TEXT_COMPRESSION_NONE;
  text.key = key.data();
  text.text = mark.data();
  png_set_text(w.png, w.info, &text, 1);
  png_write_info(w.png, w.info);
  png_write_image(w.png, rows);
  png_write_end(w.png, w.info);
  return true;
}

/// Pointers to `height` equally long rows.
std::vector<png_bytep> row_pointers(png_bytep first, std::size_t stride, std::size_t height) {
  std::vector<png_bytep> rows(height);
  for (std::size_t y = 0; y < height; ++y) rows[y] = first + y * stride;
  return rows;
}

}  // namespace

bool is_png(std::span<const std::uint8_t> bytes) noexcept {
  constexpr std::array<std::uint8_t, 8> kSignature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  return bytes.size() >= kSignature.size() && std::equal(kSignature.begin(), kSignature.end(), bytes.begin());
}

Decoded decode_png(std::span<const std::uint8_t> bytes, const std::string& name, const SizeCheck& check) {
  Reader r(bytes);
  if (r.info == nullptr) throw Error(ErrorKind::kOutOfMemory, "no memory to read " + name);
  if (!read_header(r)) damaged(r, name);
  const png_uint_32 width = png_get_image_width(r.png, r.info);
  const png_uint_32 height = png_get_image_height(r.png, r.info);
  check_image_size(width, height, name);
  if (check) check(static_cast<int>(width), static_cast<int>(height));
  std::optional<ColourProfile> profile = profile_of(r);
  if (!prepare(r)) damaged(r, name);
  const int channels = png_get_channels(r.png, r.info);
  const bool wide = png_get_bit_depth(r.png, r.info) == 16;
  const std::size_t stride = png_get_rowbytes(r.png, r.info);

  Decoded result;
  result.profile = std::move(profile);
  result.image = Image(static_cast<int>(width), static_cast<int>(height), channels);
  std::vector<png_byte> samples(stride * height);
  std::vector<png_bytep> rows = row_pointers(samples.data(), stride, height);
  if (!read_samples(r, rows.data())) damaged(r, name);
  samples_to_floats(samples, wide, result.image.data);
  png_bytep exif = nullptr;
  png_uint_32 exif_size = 0;
  if (png_get_eXIf_1(r.png, r.info, &exif_size, &exif) != 0) result.exif = parse_exif({exif, exif_size});
  return result;
}

std::vector<std::uint8_t> encode_png_samples(int width, int height, int channels, int bits,
                                             std::span<const std::uint8_t> samples) {
  constexpr std::array<int, 4> kColourTypes = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA,
                                               PNG_COLOR_TYPE_RGB, PNG_COLOR_TYPE_RGB_ALPHA};
  if (width < 1 || height < 1 || channels < 1 || channels > 4 || (bits != 8 && bits != 16)) {
    throw Error(ErrorKind::kInternal, "encode_png: 1 to 4 channels of 8 or 16 bits are needed");
  }
  const std::size_t stride = static_cast<std::size_t>(width) * static_cast<std::size_t>(channels) *
                             (static_cast<std::size_t>(bits) / 8);
  if (samples.size() != stride * static_cast<std::size_t>(height)) {
    throw Error(ErrorKind::kInternal, "encode_png: the number of samples does not fit the size");
  }
  // libpng's signature is not const-correct; it only reads the rows.
  std::vector<png_bytep> rows =
      row_pointers(const_cast<png_bytep>(samples.data()), stride, static_cast<std::size_t>(height));
  Writer w;
  if (w.info == nullptr ||
      !write_samples(w, width, height, bits, kColourTypes[static_cast<std::size_t>(channels - 1)],
                     rows.data())) {
    throw Error(ErrorKind::kOutOfMemory,
                std::string("no memory to write a PNG image ") + w.message.text.data());
  }
  return std::move(w.bytes);
}

std::vector<std::uint8_t> encode_png(const Image& image, int bits) {
  return encode_png_samples(image.width, image.height, image.channels, bits, to_samples(image, bits));
}

std::vector<std::uint8_t> to_samples(const Image& image, int bits) {
  const float top = bits == 16 ? 65535.0F : 255.0F;
  const std::size_t bytes_each = bits == 16 ? 2 : 1;
  std::vector<std::uint8_t> samples(image.data.size() * bytes_each);
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    const float v = image.data[i];
    const float clamped = v > 0 ? std::min(v, 1.0F) : 0.0F;  // NaN compares false
    const float next = clamped * top + 0.5F;                 // std::lround() is a call
    const auto sample = static_cast<unsigned>(next);
    if (bytes_each == 2) {
      samples[2 * i] = static_cast<std::uint8_t>(sample >> 8U);
      samples[2 * i + 1] = static_cast<std::uint8_t>(sample & 0xFFU);
    } else {
      samples[i] = static_cast<std::uint8_t>(sample);
    }
  }
  return samples;
}

}  // namespace slide
