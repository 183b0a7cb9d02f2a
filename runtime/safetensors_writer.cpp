#include "runtime/safetensors_writer.h"

#include <algorithm>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>

#include "runtime/crc32c.h"
#include "runtime/error.h"
#include "runtime/safetensors_header.h"

namespace slide {
namespace {

constexpr std::size_t kDataAlignment = 64;
constexpr std::string_view kNoDigits = "00000000";

void check_name(const std::string& name, std::set<std::string>& seen, const std::string& path) {
  if (find_invalid_utf8(name) || has_control_character(name) || name == "__metadata__" || name.size() > 1024)
    throw Error(ErrorKind::kInternal, path + ": \"" + name + "\" cannot be the name of a tensor");
  if (!seen.insert(name).second)
    throw Error(ErrorKind::kInternal, path + ": tensor " + name + " comes twice");
}

void check_metadata(const Metadata& metadata, const std::string& path) {
  const auto bad = std::ranges::find_if(metadata, [](const auto& entry) {
    const auto& [key, value] = entry;
    return find_invalid_utf8(key) || find_invalid_utf8(value) || key == "crc32c" ||
           key.starts_with("crc32c.");
  });
  if (bad != metadata.end())
    throw Error(ErrorKind::kInternal, path + ": the metadata's \"" + bad->first + "\" cannot be written");
}

std::string json_string(const std::string& text) { return nlohmann::json(text).dump(); }

/// Where each tensor's data starts within the data section: larger elements first, so that all are aligned.
std::vector<std::uint64_t> place(const std::vector<TensorInfo>& tensors) {
  std::vector<std::size_t> order(tensors.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::ranges::greater{},
                           [&](std::size_t i) { return size_of(tensors[i].dtype); });
  std::vector<std::uint64_t> begins(tensors.size());
  std::uint64_t end = 0;
  for (const std::size_t i : order) {
    begins[i] = end;
    end += tensors[i].bytes();
  }
  return begins;
}

std::string entry_text(const TensorInfo& info, std::uint64_t begin) {
  nlohmann::ordered_json entry;
  entry["dtype"] = name_of(info.dtype);
  entry["shape"] = std::vector<std::int64_t>(info.shape.extents().begin(), info.shape.extents().end());
  entry["data_offsets"] = {begin, begin + info.bytes()};
  return json_string(info.name) + ":" + entry.dump();
}

}  // namespace

SafetensorsWriter::SafetensorsWriter(const std::string& path, std::vector<TensorInfo> tensors,
                                     const Metadata& metadata)
    : file_(path), tensors_(std::move(tensors)), offsets_(place(tensors_)) {
  std::set<std::string> seen;
  for (const TensorInfo& info : tensors_) check_name(info.name, seen, path);
  check_metadata(metadata, path);
  // A tensor's checksum is known when its last byte is written; until then its digits are zeros.
  std::string text = std::string(sizeof(std::uint64_t), '\0') + "{\"__metadata__\":{";
  for (const auto& [key, value] : metadata) text += json_string(key) + ":" + json_string(value) + ",";
  text += "\"crc32c\":\"" + checksum_text(checksum_of_list(tensors_)) + "\"";
  for (const TensorInfo& info : tensors_) {
    text += "," + json_string("crc32c." + info.name) + ":\"";
    checksum_fields_.push_back(text.size());
    text += std::string(kNoDigits) + "\"";
  }
  text += "}";
  for (std::size_t i = 0; i < tensors_.size(); ++i) text += "," + entry_text(tensors_[i], offsets_[i]);
  text += "}";
  text.resize((text.size() + kDataAlignment - 1) / kDataAlignment * kDataAlignment, ' ');
  const std::uint64_t length = text.size() - sizeof length;
  if (length > kMaxSafetensorsHeader)
    throw Error(ErrorKind::kInternal, path + ": the list of tensors is too long for the format");
  std::memcpy(text.data(), &length, sizeof length);
  for (std::uint64_t& offset : offsets_) offset += text.size();
  file_.write(text);
  skip_complete();
}

void SafetensorsWriter::skip_complete() {
  while (current_ < tensors_.size() && written_ == tensors_[current_].bytes()) {
    const std::string digits = checksum_text(crc_);
    file_.write_at(checksum_fields_[current_], std::as_bytes(std::span(digits)));
    ++current_;
    written_ = 0;
    crc_ = 0;
  }
}

void SafetensorsWriter::write(std::span<const std::byte> bytes) {
  if (bytes.empty()) return;
  if (current_ == tensors_.size() || bytes.size() > tensors_[current_].bytes() - written_)
    throw Error(ErrorKind::kInternal, file_.path() + ": more data was written than its tensors have");
  file_.write_at(offsets_[current_] + written_, bytes);
  crc_ = crc32c(bytes, crc_);
  written_ += bytes.size();
  skip_complete();
}

void SafetensorsWriter::finish() {
  if (current_ != tensors_.size())
    throw Error(ErrorKind::kInternal,
                file_.path() + ": tensor " + tensors_[current_].name + " is not complete");
  file_.commit();
}

void write_safetensors(const std::string& path, const std::vector<std::pair<std::string, Tensor>>& tensors,
                       const Metadata& metadata) {
  std::vector<TensorInfo> list;
  list.reserve(tensors.size());
  for (const auto& [name, tensor] : tensors) list.push_back({name, tensor.dtype(), tensor.shape()});
  SafetensorsWriter writer(path, std::move(list), metadata);
  for (const auto& entry : tensors) writer.write(entry.second.raw());
  writer.finish();
}

}  // namespace slide
