#include "weights_tools/prefix.h"

#include <algorithm>
#include <utility>

#include "weights_tools/model_fit.h"

namespace slide {
namespace {

/// Another reader's tensors under shorter names.
class ShortNames : public WeightReader {
 public:
  ShortNames(const WeightReader& reader, std::size_t cut) : reader_(reader), tensors_(reader.tensors()) {
    for (TensorInfo& info : tensors_) info.name.erase(0, cut);
  }
  ShortNames(std::unique_ptr<WeightReader> reader, std::size_t cut) : ShortNames(*reader, cut) {
    owned_ = std::move(reader);
  }
  [[nodiscard]] const std::string& path() const override { return reader_.path(); }
  [[nodiscard]] std::string format() const override { return reader_.format(); }
  [[nodiscard]] const std::vector<TensorInfo>& tensors() const override { return tensors_; }
  [[nodiscard]] const Metadata& metadata() const override { return reader_.metadata(); }
  [[nodiscard]] bool has_checksums() const override { return reader_.has_checksums(); }
  void for_each_block(std::size_t i, const Take& take) const override { reader_.for_each_block(i, take); }

 private:
  std::unique_ptr<WeightReader> owned_;
  const WeightReader& reader_;
  std::vector<TensorInfo> tensors_;
};

bool fits(const WeightReader& reader, const std::string& model) {
  return (model.empty() ? closest_model(reader) : fit_model(reader, model)).fit.usable();
}

/// How many characters the names have in common, up to and including a full stop.
std::size_t shared_components(const std::vector<TensorInfo>& tensors) {
  if (tensors.empty()) return 0;
  std::string_view shared = tensors.front().name;
  for (const TensorInfo& info : tensors)
    shared = shared.substr(
        0, static_cast<std::size_t>(std::ranges::mismatch(shared, info.name).in1 - shared.begin()));
  const std::size_t end = shared.rfind('.');
  return end == std::string_view::npos ? 0 : end + 1;
}

}  // namespace

std::string needless_prefix(const WeightReader& reader, const std::string& model) {
  const std::size_t shared = shared_components(reader.tensors());
  if (shared == 0 || fits(reader, model)) return "";
  const std::string prefix = reader.tensors().front().name.substr(0, shared);
  for (std::size_t cut = prefix.find('.') + 1; cut != 0; cut = prefix.find('.', cut) + 1)
    if (fits(ShortNames(reader, cut), model)) return prefix.substr(0, cut);
  return "";
}

std::unique_ptr<WeightReader> without_prefix(std::unique_ptr<WeightReader> reader,
                                             const std::string& prefix) {
  return std::make_unique<ShortNames>(std::move(reader), prefix.size());
}

}  // namespace slide
