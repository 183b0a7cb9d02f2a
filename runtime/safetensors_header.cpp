#include "runtime/safetensors_header.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <span>
#include <utility>

#include "runtime/crc32c.h"
#include "runtime/error.h"

namespace slide {
namespace {

constexpr std::uint64_t kHeaderStart = 8;
constexpr std::size_t kMaxName = 1024;

/// A text of the file's for a message: not too long, and without control characters, which a terminal would
/// obey.
std::string quoted(std::string text) {
  constexpr std::size_t kShown = 60;
  if (text.size() > kShown) text = text.substr(0, kShown) + "...";
  for (char& c : text)
    if (has_control_character({&c, 1})) c = '?';
  return '"' + text + '"';
}

/// Reads the header's characters and counts them, so that a handler knows where in the file it is.
class CountingIterator {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  CountingIterator(const char* at, const char** furthest) : at_(at), furthest_(furthest) {}
  reference operator*() const { return *at_; }
  CountingIterator& operator++() {
    *furthest_ = ++at_;
    return *this;
  }
  CountingIterator operator++(int) {
    CountingIterator before = *this;
    ++*this;
    return before;
  }
  [[maybe_unused]] friend bool operator==(const CountingIterator& a, const CountingIterator& b) {
    return a.at_ == b.at_;
  }

 private:
  const char* at_;
  const char** furthest_;
};

/// Takes the parser's events (nlohmann's SAX interface) and accepts only
///   { "__metadata__": {string: string, ...}, NAME: {"dtype": string, "shape": [n, ...], "data_offsets": [n,
///   n]}, ... }
/// Nothing nests deeper than this, so a deeply nested text ends at its third bracket.
class HeaderHandler {
 public:
  HeaderHandler(const std::string& file, const char* start, const char* const* furthest)
      : file_(file), start_(start), furthest_(furthest) {}

  bool null() { return unexpected("null"); }
  bool boolean(bool /*value*/) { return unexpected("a truth value"); }
  bool number_integer(std::int64_t /*value*/) { return unexpected("a negative number"); }
  bool number_float(double /*value*/, const std::string& text) {
    return unexpected("the number " + text.substr(0, 40) + ", which is no 64-bit integer,");
  }
  bool binary(const std::vector<std::uint8_t>& /*value*/) { return unexpected("binary data"); }
  bool number_unsigned(std::uint64_t value) {
    if (place_ != Place::kArray) return unexpected("a number");
    const bool shape = field_ == "shape";
    numbers_.push_back(value);
    if (numbers_.size() > (shape ? static_cast<std::size_t>(Shape::kMaxRank) : 2))
      throw failure(shape ? "has more than five dimensions" : "data_offsets has more than two numbers");
    return true;
  }
  bool string(std::string& value) {
    if (place_ == Place::kMetadata) {
      header_.metadata[field_] = std::move(value);
    } else if (place_ == Place::kTensor && field_ == "dtype") {
      const std::optional<DType> type = dtype_from_name(value);
      if (!type) throw failure("unknown dtype " + quoted(value));
      entry_.info.dtype = *type;
    } else {
      return unexpected("a string");
    }
    return true;
  }
  bool key(std::string& name) {
    if (place_ == Place::kTop) return top_key(name);
    if (!seen_.insert(name).second) throw failure("the key " + quoted(name) + " comes twice");
    if (place_ == Place::kTensor && name != "dtype" && name != "shape" && name != "data_offsets")
      throw failure("unknown key " + quoted(name));
    field_ = std::move(name);
    return true;
  }
  bool start_object(std::size_t /*size*/) {
    if (place_ == Place::kNone) {
      place_ = Place::kTop;
    } else if (place_ == Place::kTop) {
      place_ = name_ == "__metadata__" ? Place::kMetadata : Place::kTensor;
      seen_.clear();
      entry_ = {};
    } else {
      return unexpected("an object");
    }
    return true;
  }
  bool end_object() {
    if (place_ == Place::kTensor) finish_tensor();
    place_ = place_ == Place::kTop ? Place::kNone : Place::kTop;
    return true;
  }
  bool start_array(std::size_t /*size*/) {
    if (place_ != Place::kTensor || field_ == "dtype") return unexpected("an array");
    place_ = Place::kArray;
    numbers_.clear();
    return true;
  }
  bool end_array() {
    place_ = Place::kTensor;
    if (field_ == "shape") {
      set_shape();
    } else {
      if (numbers_.size() != 2) throw failure("data_offsets needs two numbers");
      entry_.begin = numbers_[0];
      entry_.end = numbers_[1];
    }
    return true;
  }
  template <typename Exception>
  bool parse_error(std::size_t characters_read, const std::string& /*token*/,
                   const Exception& /*exception*/) {
    throw Error(ErrorKind::kBadWeights,
                file_ + ": the header is not valid JSON (byte " +
                    std::to_string(kHeaderStart + std::max<std::size_t>(characters_read, 1) - 1) + ")");
  }

  SafetensorsHeader take() { return std::move(header_); }

 private:
  enum class Place { kNone, kTop, kMetadata, kTensor, kArray };

  [[nodiscard]] Error failure(const std::string& problem) const {
    const std::string where = place_ == Place::kNone || name_.empty() ? ""
                              : name_ == "__metadata__"               ? "the metadata: "
                                                                      : "tensor " + name_ + ": ";
    return Error(ErrorKind::kBadWeights,
                 file_ + ": " + where + problem + " (near byte " +
                     std::to_string(kHeaderStart + static_cast<std::uint64_t>(*furthest_ - start_)) + ")");
  }
  bool unexpected(const std::string& what) {
    const char* wanted = place_ == Place::kNone       ? "the header must be an object"
                         : place_ == Place::kTop      ? "an entry must be an object"
                         : place_ == Place::kMetadata ? "metadata values must be strings"
                         : field_ == "dtype"          ? "dtype must be a string"
                                             : "shape and data_offsets must be arrays of whole numbers";
    throw failure(what + " is not allowed here: " + wanted);
  }
  bool top_key(std::string& name) {
    name_.clear();
    if (name.size() > kMaxName)
      throw failure("a tensor's name is longer than " + std::to_string(kMaxName) + " bytes");
    if (has_control_character(name)) throw failure("a tensor's name holds a control character");
    name_ = name;
    if (!names_.insert(std::move(name)).second) throw failure("the name comes twice");
    return true;
  }
  void set_shape() {
    std::uint64_t count = 1;
    for (const std::uint64_t extent : numbers_)
      if (__builtin_mul_overflow(count, std::max<std::uint64_t>(extent, 1), &count) || count >> 56 != 0)
        throw failure("the product of its dimensions is too large");
    std::vector<std::int64_t> extents;
    extents.reserve(numbers_.size());
    for (const std::uint64_t extent : numbers_) extents.push_back(static_cast<std::int64_t>(extent));
    entry_.info.shape = Shape(extents);
  }
  void finish_tensor() {
    for (const char* needed : {"dtype", "shape", "data_offsets"})
      if (!seen_.contains(needed)) throw failure(std::string("has no \"") + needed + "\"");
    if (entry_.begin > entry_.end || entry_.end - entry_.begin != entry_.info.bytes())
      throw failure("data_offsets " + std::to_string(entry_.begin) + " to " + std::to_string(entry_.end) +
                    " do not fit " + std::string(name_of(entry_.info.dtype)) + " of shape " +
                    entry_.info.shape.text() + ", which takes " + std::to_string(entry_.info.bytes()) +
                    " bytes");
    entry_.info.name = name_;
    header_.entries.push_back(std::move(entry_));
  }

  const std::string& file_;
  const char* start_;
  const char* const* furthest_;
  Place place_ = Place::kNone;
  std::string name_;   // of the tensor at hand, or "__metadata__"
  std::string field_;  // the key at hand within it
  std::set<std::string, std::less<>> names_;
  std::set<std::string, std::less<>> seen_;
  std::vector<std::uint64_t> numbers_;
  SafetensorsHeader::Entry entry_;
  SafetensorsHeader header_;
};

/// In the order of their data the tensors must follow one another and end where the data ends.
void check_coverage(const SafetensorsHeader& header, std::uint64_t data_start, std::uint64_t data_size,
                    const std::string& file) {
  std::vector<const SafetensorsHeader::Entry*> order;
  order.reserve(header.entries.size());
  for (const SafetensorsHeader::Entry& entry : header.entries) order.push_back(&entry);
  std::ranges::stable_sort(order, {}, [](const auto* e) { return std::pair(e->begin, e->end); });
  std::uint64_t end = 0;
  const auto what = [](const SafetensorsHeader::Entry* entry) {
    return entry == nullptr ? "the start of the data" : "tensor " + entry->info.name;
  };
  const SafetensorsHeader::Entry* last = nullptr;
  const auto fail = [&](const std::string& problem, std::uint64_t at) {
    return Error(ErrorKind::kBadWeights,
                 file + ": " + problem + " (byte " + std::to_string(data_start + at) + ")");
  };
  for (const SafetensorsHeader::Entry* entry : order) {
    if (entry->end > data_size)
      throw fail(what(entry) + " ends at byte " + std::to_string(entry->end) +
                     " of the data, of which there are " + std::to_string(data_size) +
                     " bytes; the file is cut short",
                 data_size);
    if (entry->begin < end) throw fail(what(entry) + " overlaps " + what(last), entry->begin);
    if (entry->begin > end)
      throw fail(std::to_string(entry->begin - end) + " bytes between " + what(last) + " and " + what(entry) +
                     " belong to no tensor",
                 end);
    end = entry->end;
    last = entry;
  }
  if (end != data_size)
    throw fail(std::to_string(data_size - end) + " bytes after the last tensor belong to no tensor", end);
}

}  // namespace

SafetensorsHeader parse_safetensors_header(std::string_view text, std::uint64_t data_size,
                                           const std::string& file) {
  if (const std::optional<std::size_t> bad = find_invalid_utf8(text))
    throw Error(ErrorKind::kBadWeights,
                file + ": the header is not UTF-8 (byte " + std::to_string(kHeaderStart + *bad) + ")");
  if (!text.starts_with('{'))
    throw Error(ErrorKind::kBadWeights, file + ": the header does not start with \"{\" (byte 8)",
                "is it a safetensors file? slide_convert reads PyTorch checkpoints");
  const char* furthest = text.data();
  HeaderHandler handler(file, text.data(), &furthest);
  nlohmann::json::sax_parse(CountingIterator(text.data(), &furthest),
                            CountingIterator(text.data() + text.size(), &furthest), &handler);
  SafetensorsHeader header = handler.take();
  check_coverage(header, kHeaderStart + text.size(), data_size, file);
  return header;
}

std::uint32_t checksum_of_list(const std::vector<TensorInfo>& tensors) {
  std::vector<const TensorInfo*> order;
  order.reserve(tensors.size());
  for (const TensorInfo& info : tensors) order.push_back(&info);
  std::ranges::sort(order, {}, &TensorInfo::name);
  std::uint32_t crc = 0;
  for (const TensorInfo* info : order) {
    std::string line = info->name;
    line.append(1, '\0').append(name_of(info->dtype)).append(1, '\0');
    for (int axis = 0; axis < info->shape.rank(); ++axis)
      line.append(axis > 0 ? "x" : "").append(std::to_string(info->shape[axis]));
    line.append(1, '\n');
    crc = crc32c(std::as_bytes(std::span(line)), crc);
  }
  return crc;
}

std::string checksum_text(std::uint32_t crc) {
  std::string text;
  for (int shift = 28; shift >= 0; shift -= 4) text += "0123456789abcdef"[(crc >> shift) & 15u];
  return text;
}

std::optional<std::size_t> find_invalid_utf8(std::string_view text) noexcept {
  for (std::size_t i = 0; i < text.size();) {
    const auto lead = static_cast<unsigned char>(text[i]);
    const std::size_t length = lead < 0x80   ? 1
                               : lead < 0xC2 ? 0
                               : lead < 0xE0 ? 2
                               : lead < 0xF0 ? 3
                               : lead < 0xF5 ? 4
                                             : 0;
    if (length == 0 || i + length > text.size()) return i;
    for (std::size_t k = 1; k < length; ++k) {
      const auto next = static_cast<unsigned char>(text[i + k]);
      // The second byte excludes overlong forms (E0, F0), surrogates (ED) and code points over U+10FFFF (F4).
      const unsigned low = k == 1 && lead == 0xE0 ? 0xA0 : k == 1 && lead == 0xF0 ? 0x90 : 0x80;
      const unsigned high = k == 1 && lead == 0xED ? 0x9F : k == 1 && lead == 0xF4 ? 0x8F : 0xBF;
      if (next < low || next > high) return i;
    }
    i += length;
  }
  return std::nullopt;
}

bool has_control_character(std::string_view name) noexcept {
  return std::ranges::any_of(name, [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte < 0x20 || byte == 0x7F;
  });
}

}  // namespace slide
