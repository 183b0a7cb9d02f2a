#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "weights_tools/file_reader.h"
#include "weights_tools/pickle.h"
#include "weights_tools/weight_reader.h"
#include "weights_tools/zip.h"

namespace slide {

/// A PyTorch checkpoint, as torch.save writes it: the zip archive of 1.6 and later, or the stream of pickles
/// before. The tensors are those of a state_dict: the dictionary itself, or one nested in it, or that of a
/// whole network (torch.nn.Module) that was saved. Other objects beside them are skipped.
class Checkpoint final : public WeightReader {
 public:
  enum class Format { kZip, kStream };

  /// What the file's first bytes say, or nothing.
  static std::optional<Format> recognise(const FileReader& file);

  Checkpoint(std::unique_ptr<FileReader> file, Format format, const std::string& key);

  [[nodiscard]] const std::string& path() const override { return file_->path(); }
  [[nodiscard]] std::string format() const override {
    return format_ == Format::kZip ? "PyTorch zip" : "PyTorch stream";
  }
  [[nodiscard]] const std::vector<TensorInfo>& tensors() const override { return tensors_; }
  [[nodiscard]] const Metadata& metadata() const override { return metadata_; }
  [[nodiscard]] bool has_checksums() const override { return format_ == Format::kZip; }
  void for_each_block(std::size_t i, const Take& take) const override;

 private:
  void read_zip();
  void read_stream();
  [[nodiscard]] Pickle read_pickle_at(std::uint64_t offset) const;
  void select_tensors(const std::string& key);
  void add_tensor(const std::string& name, std::size_t view);
  void check_total() const;
  [[nodiscard]] std::span<const std::byte> storage(std::size_t index) const;

  std::unique_ptr<FileReader> file_;
  Format format_;
  std::unique_ptr<ZipArchive> zip_;
  Pickle pickle_;
  std::vector<const ZipArchive::Member*> members_;  // kZip: of each storage
  std::vector<std::uint64_t> offsets_;              // kStream: of each storage's data
  std::vector<TensorInfo> tensors_;
  std::vector<std::size_t> views_;  // of each tensor: index into pickle_.tensors
  Metadata metadata_;
  // The storage read last: one after the other is all that is ever in memory.
  mutable std::optional<std::size_t> cached_;
  mutable std::vector<std::byte> cache_;
};

}  // namespace slide
