#include "weights_tools/weight_reader.h"

#include <algorithm>

#include "runtime/error.h"
#include "weights_tools/checkpoint.h"

namespace slide {
namespace {

class SafetensorsReader : public WeightReader {
 public:
  explicit SafetensorsReader(const std::string& path) : file_(SafetensorsFile::open(path)) {}
  [[nodiscard]] const std::string& path() const override { return file_.description(); }
  [[nodiscard]] std::string format() const override { return "safetensors"; }
  [[nodiscard]] const std::vector<TensorInfo>& tensors() const override { return file_.tensors(); }
  [[nodiscard]] const Metadata& metadata() const override { return file_.metadata(); }
  [[nodiscard]] bool has_checksums() const override { return file_.has_checksums(); }
  void for_each_block(std::size_t i, const Take& take) const override {
    constexpr std::size_t kBlock = std::size_t{1} << 20;
    file_.verify_crc(tensors()[i].name);
    const Tensor tensor = file_.tensor(tensors()[i].name);
    std::span<const std::byte> rest = tensor.raw();
    while (!rest.empty()) {
      const std::size_t n = std::min(rest.size(), kBlock);
      take(rest.first(n));
      rest = rest.subspan(n);
    }
  }

 private:
  SafetensorsFile file_;
};

}  // namespace

std::unique_ptr<WeightReader> open_weights(const std::string& path, const std::string& key) {
  auto file = std::make_unique<FileReader>(path);
  if (file->size() == 0) throw Error(ErrorKind::kBadWeights, path + ": the file is empty");
  if (const std::optional<Checkpoint::Format> format = Checkpoint::recognise(*file))
    return std::make_unique<Checkpoint>(std::move(file), *format, key);
  if (!key.empty())
    throw Error(ErrorKind::kUsage, path + ": --key is for PyTorch checkpoints, which this file is not");
  return std::make_unique<SafetensorsReader>(path);
}

Tensor load(const WeightReader& reader, std::size_t i) {
  const TensorInfo& info = reader.tensors()[i];
  Tensor tensor(info.dtype, info.shape);
  std::span<std::byte> rest = tensor.mutable_raw();
  reader.for_each_block(i, [&](std::span<const std::byte> block) {
    std::ranges::copy(block, rest.begin());
    rest = rest.subspan(block.size());
  });
  return tensor;
}

}  // namespace slide
