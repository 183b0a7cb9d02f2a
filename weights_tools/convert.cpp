#include "weights_tools/convert.h"

#include <algorithm>
#include <filesystem>

#include "runtime/atomic_file.h"
#include "runtime/calibration.h"
#include "runtime/error.h"
#include "runtime/own_file.h"
#include "runtime/safetensors_header.h"
#include "runtime/safetensors_writer.h"
#include "weights_tools/file_reader.h"
#include "weights_tools/model_fit.h"

namespace slide {
namespace {

bool floating(DType type) {
  return type == DType::kF64 || type == DType::kF32 || type == DType::kF16 || type == DType::kBF16;
}

std::string file_name(const std::string& path) { return std::filesystem::path(path).filename().string(); }

/// A text without what metadata or a terminal cannot take.
std::string plain(std::string text) {
  if (find_invalid_utf8(text)) return "(not UTF-8)";
  for (char& c : text)
    if (has_control_character({&c, 1})) c = '?';
  return text;
}

/// The model that the tensors are for; a warning if they fit it but more is there.
std::string checked_model(const WeightReader& reader, const std::string& wanted,
                          std::vector<std::string>& warnings) {
  constexpr const char* kRemedy = "--model any converts without looking";
  if (wanted == "any") return wanted;
  if (wanted.empty()) {
    Detection found = detect_model(reader);
    if (found.model.empty()) throw Error(ErrorKind::kBadWeights, found.detail, kRemedy);
    if (!found.detail.empty()) warnings.push_back(std::move(found.detail));
    return found.model;
  }
  const ModelFit fit = fit_model(reader, wanted);
  std::string detail = fit.fit.message(reader.path() + " as " + wanted);
  if (!fit.fit.usable()) throw Error(ErrorKind::kBadWeights, detail, kRemedy);
  if (!detail.empty()) warnings.push_back(std::move(detail));
  return wanted;
}

Metadata metadata_for(const WeightReader& reader, const ConvertReport& report, bool keep_calibration) {
  Metadata metadata = reader.metadata();
  std::erase_if(metadata, [](const auto& entry) {
    return entry.first == "crc32c" || entry.first.starts_with("crc32c.");
  });
  if (!keep_calibration) metadata.erase(std::string(kCalibrationKey));
  if (report.model != "any") metadata["model"] = report.model;
  metadata["format"] = "pt";  // tells the safetensors tools of others that the layout is PyTorch's
  if (!metadata.contains("source_sha256")) {
    metadata["source_file"] = plain(file_name(reader.path()));
    metadata["source_sha256"] = report.sha256;
  }
  return metadata;
}

Error not_finite(const WeightReader& reader, const TensorInfo& info, std::size_t element) {
  return Error(ErrorKind::kBadWeights,
               reader.path() + ": tensor " + info.name + ": element " + std::to_string(element) +
                   " is not a finite number",
               "the network was saved after its training had diverged, or the file is damaged");
}

/// Converts one tensor block by block. Returns true if all its values are finite, which they must be.
bool copy_tensor(const WeightReader& reader, std::size_t i, DType dtype, bool must_be_finite,
                 SafetensorsWriter& writer) {
  const TensorInfo& info = reader.tensors()[i];
  bool finite = true;
  std::size_t before = 0;
  reader.for_each_block(i, [&](std::span<const std::byte> block) {
    const auto count = static_cast<std::int64_t>(block.size() / size_of(info.dtype));
    const Tensor converted = Tensor::read_only(info.dtype, {count}, block.data(), nullptr).to(dtype);
    if (const auto element = first_not_finite(info.dtype, block)) {
      if (must_be_finite) throw not_finite(reader, info, before + *element);
      finite = false;
    } else if (dtype != info.dtype && first_not_finite(dtype, converted.raw())) {
      throw Error(ErrorKind::kBadWeights,
                  reader.path() + ": tensor " + info.name + " holds a value too large for " +
                      std::string(name_of(dtype)),
                  "choose another --dtype");
    }
    writer.write(converted.raw());
    before += static_cast<std::size_t>(count);
  });
  return finite;
}

/// Whether convert() has made a file and nobody has changed it since: it says what it was made of, and its
/// checksums, which only SLIDE writes, belong to what it holds.
bool made_here(const std::string& path) {
  try {
    const SafetensorsFile file = SafetensorsFile::open(path);
    return file.metadata().contains("source_sha256") && file.metadata().contains("crc32c") &&
           file.has_checksums() && file.verify_crc() == file.tensors().size();
  } catch (const Error& e) {
    if (e.kind() != ErrorKind::kBadWeights) throw;
    return false;
  }
}

/// A complete but unnamed file again, under the same name to be, with the calibration in its metadata.
std::size_t write_calibrated(const std::string& unnamed, const std::string& output, const std::string& model,
                             const ConvertOptions& options) {
  const SafetensorsWeights weights(unnamed);
  const Calibration calibration = options.calibrate(model, weights);
  Metadata metadata = weights.file().metadata();
  std::erase_if(metadata, [](const auto& entry) { return entry.first.starts_with("crc32c"); });
  metadata.insert_or_assign(std::string(kCalibrationKey), text_of(calibration));
  SafetensorsWriter writer(output, weights.file().tensors(), metadata);
  for (const TensorInfo& info : weights.file().tensors()) {
    writer.write(weights.file().tensor(info.name).raw());
    weights.release(info.name);
  }
  writer.finish();
  return calibration.layers.size();
}

}  // namespace

std::optional<std::string> hash_in_name(const std::string& path) {
  const std::string stem = std::filesystem::path(path).stem().string();
  const std::size_t hyphen = stem.rfind('-');
  if (hyphen == std::string::npos) return std::nullopt;
  std::string digits = stem.substr(hyphen + 1);
  const bool hexadecimal =
      std::ranges::all_of(digits, [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
  if (!hexadecimal || digits.size() < 8 || digits.size() > 64) return std::nullopt;
  return digits;
}

ConvertReport convert(const WeightReader& reader, const std::string& output, const ConvertOptions& options) {
  if (options.dtype != DType::kF32 && options.dtype != DType::kF16 && options.dtype != DType::kBF16)
    throw Error(ErrorKind::kUsage, "weights are written as F32, F16 or BF16");
  if (same_file(reader.path(), output))
    throw Error(ErrorKind::kUsage, output + ": this is the file that is read", "choose another --output");
  if (!options.overwrite) require_own_file(output, made_here);
  ConvertReport report;
  report.model = checked_model(reader, options.model, report.warnings);
  report.sha256 = sha256_of(FileReader(reader.path()));
  if (const auto digits = hash_in_name(reader.path()); digits && !report.sha256.starts_with(*digits))
    report.warnings.push_back(reader.path() + ": the name promises a SHA-256 that starts with " + *digits +
                              ", it is " + report.sha256 +
                              ": the file is damaged or not the one it is named after");

  std::vector<TensorInfo> list = reader.tensors();
  for (TensorInfo& info : list) {
    if (floating(info.dtype)) info.dtype = options.dtype;
    report.bytes += info.bytes();
  }
  report.tensors = list.size();
  SafetensorsWriter writer(output, list, metadata_for(reader, report, !options.calibrate));
  for (std::size_t i = 0; i < list.size(); ++i)
    if (!copy_tensor(reader, i, list[i].dtype, report.model != "any", writer))
      report.warnings.push_back(reader.path() + ": tensor " + list[i].name +
                                " holds values that are not finite");
  if (options.calibrate)
    report.calibrated = write_calibrated(writer.temporary_path(), output, report.model, options);
  else
    writer.finish();
  return report;
}

std::string listing(const WeightReader& reader) {
  std::vector<std::array<std::string, 4>> rows = {{"name", "dtype", "shape", "bytes"}};
  std::uint64_t total = 0;
  for (const TensorInfo& info : reader.tensors()) {
    rows.push_back(
        {info.name, std::string(name_of(info.dtype)), info.shape.text(), std::to_string(info.bytes())});
    total += info.bytes();
  }
  std::array<std::size_t, 4> width{};
  for (const auto& row : rows)
    for (std::size_t k = 0; k < row.size(); ++k) width[k] = std::max(width[k], row[k].size());
  std::string text;
  for (const auto& row : rows) {
    for (std::size_t k = 0; k < 3; ++k) text.append(row[k]).append(width[k] - row[k].size() + 2, ' ');
    text.append(width[3] - row[3].size(), ' ').append(row[3]).append("\n");
  }
  text.append(std::to_string(reader.tensors().size()) + " tensors, " + std::to_string(total) + " bytes, " +
              reader.format() + "\n");
  const Detection found = detect_model(reader);
  if (!found.model.empty()) text.append("fits " + found.model + "\n");
  if (!found.detail.empty()) text.append(found.detail + "\n");
  for (const auto& [key, value] : reader.metadata())
    if (!key.starts_with("crc32c")) text.append(plain(key)).append(": ").append(plain(value)).append("\n");
  return text;
}

std::string verify(const WeightReader& reader) {
  for (std::size_t i = 0; i < reader.tensors().size(); ++i) {
    const TensorInfo& info = reader.tensors()[i];
    std::size_t before = 0;
    reader.for_each_block(i, [&](std::span<const std::byte> block) {
      if (const auto element = first_not_finite(info.dtype, block))
        throw not_finite(reader, info, before + *element);
      before += block.size() / size_of(info.dtype);
    });
  }
  const std::string checked = !reader.has_checksums()            ? "it has no checksums"
                              : reader.format() == "PyTorch zip" ? "the archive's checksums match"
                                                                 : "all checksums match";
  return reader.path() + ": " + std::to_string(reader.tensors().size()) + " tensors, " + checked +
         ", all values are finite";
}

}  // namespace slide
