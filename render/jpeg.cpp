#include <array>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>

#include "render/codec.h"
#include "render/image_file.h"
#include "runtime/error.h"

// jpeglib.h needs FILE and size_t declared before it.
#include <jerror.h>
#include <jpeglib.h>

// libjpeg reports errors through a callback that must not return. It leaves by longjmp, which may not skip
// the destructors of C++ objects; so each function below that calls setjmp holds only plain data, and
// everything with a destructor belongs to its caller.

namespace slide {
namespace {

constexpr int kMaxScans = 1000;  // a progressive file needs about ten; each costs a pass over the whole image

struct ErrorState {
  jpeg_error_mgr manager;  // first, so that libjpeg's pointer to it is a pointer to this
  std::jmp_buf escape;
  std::array<char, JMSG_LENGTH_MAX> message;
};

[[noreturn]] void leave_with_message(j_common_ptr info) {
  auto* state = reinterpret_cast<ErrorState*>(info->err);
  info->err->format_message(info, state->message.data());
  std::longjmp(state->escape, 1);
}

/// Warnings that mean lost picture data; libjpeg would go on with grey or repeated blocks.
bool is_damage(int code) {
  switch (code) {
    case JWRN_BOGUS_PROGRESSION:
    case JWRN_HIT_MARKER:
    case JWRN_HUFF_BAD_CODE:
    case JWRN_MUST_RESYNC:
    case JWRN_NOT_SEQUENTIAL:
      return true;
    default:
      return false;
  }
}

/// Whether all of the picture comes in the scan being read: then a file that ends without its end marker
/// lacks nothing else, or JWRN_HIT_MARKER tells that it does.
bool one_scan_has_all(j_common_ptr info) {
  if (info->is_decompressor == 0) return false;
  const auto* r = reinterpret_cast<j_decompress_ptr>(info);
  return r->progressive_mode == 0 && r->num_components > 0 && r->comps_in_scan == r->num_components;
}

void on_message(j_common_ptr info, int level) {
  if (level >= 0) return;
  const int code = info->err->msg_code;
  if (is_damage(code) || (code == JWRN_JPEG_EOF && !one_scan_has_all(info))) leave_with_message(info);
}

void count_scans(j_common_ptr info) {
  if (info->is_decompressor == 0) return;
  if (reinterpret_cast<j_decompress_ptr>(info)->input_scan_number > kMaxScans) {
    info->err->msg_code = JERR_BAD_PROGRESSION;
    leave_with_message(info);
  }
}

void install(ErrorState& state) {
  jpeg_std_error(&state.manager);
  state.manager.error_exit = leave_with_message;
  state.manager.emit_message = on_message;
  state.message[0] = '\0';
}

struct Reader {
  jpeg_decompress_struct info{};
  ErrorState errors{};
  jpeg_progress_mgr progress{};

  Reader() = default;
  ~Reader() { jpeg_destroy_decompress(&info); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
};

bool read_header(Reader& r, const unsigned char* data, unsigned long size) {
  install(r.errors);
  r.info.err = &r.errors.manager;
  if (setjmp(r.errors.escape) != 0) return false;
  jpeg_create_decompress(&r.info);
  r.progress.progress_monitor = count_scans;
  r.info.progress = &r.progress;
  jpeg_save_markers(&r.info, JPEG_APP0 + 1, 0xFFFF);
  jpeg_save_markers(&r.info, JPEG_APP0 + 2, 0xFFFF);
  jpeg_mem_src(&r.info, data, size);
  jpeg_read_header(&r.info, TRUE);
  return true;
}

bool read_samples(Reader& r, unsigned char* out, std::size_t stride) {
  if (setjmp(r.errors.escape) != 0) return false;
  jpeg_start_decompress(&r.info);
  while (r.info.output_scanline < r.info.output_height) {
    JSAMPROW row = out + r.info.output_scanline * stride;
    jpeg_read_scanlines(&r.info, &row, 1);
  }
  jpeg_finish_decompress(&r.info);
  return true;
}

Exif find_exif(const Reader& r) {
  constexpr std::array<std::uint8_t, 6> kIdentifier = {'E', 'x', 'i', 'f', 0, 0};
  for (const jpeg_marker_struct* m = r.info.marker_list; m != nullptr; m = m->next) {
    const std::span<const std::uint8_t> bytes(m->data, m->data_length);
    if (m->marker == JPEG_APP0 + 1 && bytes.size() > kIdentifier.size() &&
        std::equal(kIdentifier.begin(), kIdentifier.end(), bytes.begin())) {
      return parse_exif(bytes.subspan(kIdentifier.size()));
    }
  }
  return {};
}

/// The ICC profile, put together from its parts (ICC.1:2022, annex B.4); empty where one is missing.
std::vector<std::uint8_t> find_profile(const Reader& r) {
  constexpr std::array<std::uint8_t, 12> kIdentifier = {'I', 'C', 'C', '_', 'P', 'R',
                                                        'O', 'F', 'I', 'L', 'E', 0};
  constexpr std::size_t kHead = kIdentifier.size() + 2;  // which part, of how many
  std::vector<std::uint8_t> profile;
  for (unsigned part = 1;; ++part) {
    bool found = false;
    for (const jpeg_marker_struct* m = r.info.marker_list; m != nullptr && !found; m = m->next) {
      const std::span<const std::uint8_t> bytes(m->data, m->data_length);
      if (m->marker != JPEG_APP0 + 2 || bytes.size() <= kHead || bytes[kIdentifier.size()] != part ||
          !std::equal(kIdentifier.begin(), kIdentifier.end(), bytes.begin()))
        continue;
      found = true;
      profile.insert(profile.end(), bytes.begin() + kHead, bytes.end());
      if (part == bytes[kIdentifier.size() + 1]) return profile;
    }
    if (!found) return {};
  }
}

[[noreturn]] void damaged(const Reader& r, const std::string& name) {
  throw Error(ErrorKind::kBadInput, name + " is a damaged JPEG file: " + r.errors.message.data(),
              "copy or download it again, or open and save it in an image editor");
}

struct Writer {
  jpeg_compress_struct info{};
  ErrorState errors{};
  unsigned char* bytes = nullptr;
  unsigned long size = 0;

  Writer() = default;
  ~Writer() {
    jpeg_destroy_compress(&info);
    std::free(bytes);
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
};

bool write_samples(Writer& w, const Image& image, int quality, const unsigned char* samples) {
  install(w.errors);
  w.info.err = &w.errors.manager;
  if (setjmp(w.errors.escape) != 0) return false;
  jpeg_create_compress(&w.info);
  jpeg_mem_dest(&w.info, &w.bytes, &w.size);
  w.info.image_width = static_cast<JDIMENSION>(image.width);
  w.info.image_height = static_cast<JDIMENSION>(image.height);
  w.info.input_components = image.channels;
  w.info.in_color_space = image.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&w.info);
  jpeg_set_quality(&w.info, quality, TRUE);
  w.info.optimize_coding = TRUE;
  w.info.comp_info[0].h_samp_factor = 1;
  w.info.comp_info[0].v_samp_factor = 1;
  jpeg_start_compress(&w.info, TRUE);
  constexpr std::array<JOCTET, 5> kMark = {'S', 'L', 'I', 'D',
                                           'E'};  // by which require_replaceable() knows it
  jpeg_write_marker(&w.info, JPEG_COM, kMark.data(), kMark.size());
  const std::size_t stride = static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.channels);
  while (w.info.next_scanline < w.info.image_height) {
    JSAMPROW row = const_cast<unsigned char*>(samples) + w.info.next_scanline * stride;
    jpeg_write_scanlines(&w.info, &row, 1);
  }
  jpeg_finish_compress(&w.info);
  return true;
}

}  // namespace

bool is_jpeg(std::span<const std::uint8_t> bytes) noexcept {
  return bytes.size() >= 3 && bytes[0] == 0xFF && bytes[1] == 0xD8 && bytes[2] == 0xFF;
}

Decoded decode_jpeg(std::span<const std::uint8_t> bytes, const std::string& name, const SizeCheck& check) {
  Reader r;
  if (!read_header(r, bytes.data(), static_cast<unsigned long>(bytes.size()))) damaged(r, name);
  check_image_size(r.info.image_width, r.info.image_height, name);
  if (check) check(static_cast<int>(r.info.image_width), static_cast<int>(r.info.image_height));
  if (r.info.jpeg_color_space == JCS_CMYK || r.info.jpeg_color_space == JCS_YCCK) {
    throw Error(ErrorKind::kBadInput,
                name + " is a CMYK (print) JPEG file; its colours depend on a printer profile",
                "convert it to RGB in an image editor first");
  }
  const bool grey = r.info.jpeg_color_space == JCS_GRAYSCALE;
  r.info.out_color_space = grey ? JCS_GRAYSCALE : JCS_RGB;
  Decoded result;
  result.exif = find_exif(r);
  result.profile = read_icc_profile(find_profile(r));
  result.image =
      Image(static_cast<int>(r.info.image_width), static_cast<int>(r.info.image_height), grey ? 1 : 3);
  std::vector<unsigned char> samples(result.image.data.size());
  if (!read_samples(r, samples.data(), samples.size() / r.info.image_height)) damaged(r, name);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    result.image.data[i] = static_cast<float>(samples[i]) / 255.0F;
  }
  return result;
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
  if (image.empty() || (image.channels != 1 && image.channels != 3)) {
    throw Error(ErrorKind::kInternal, "encode_jpeg: an image of 1 or 3 channels is needed");
  }
  const std::vector<std::uint8_t> samples = to_samples(image, 8);
  Writer w;
  if (!write_samples(w, image, quality, samples.data())) {
    throw Error(ErrorKind::kInternal, std::string("encode_jpeg: ") + w.errors.message.data());
  }
  return {w.bytes, w.bytes + w.size};
}

}  // namespace slide
