#include "weights_tools/transformers_names.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "runtime/error.h"

namespace slide {
namespace {

/// How the library's names begin, and the authors'. * is a number n there and `first` + `step`·n here.
struct Rule {
  std::string_view theirs, authors;
  int first = 0;
  int step = 1;
};
/// The more special rules come first. The first three are the parts of one tensor, in order.
constexpr std::size_t kParts = 3;
constexpr Rule kRules[] = {
    {"backbone.encoder.layer.*.attention.attention.query.", "pretrained.blocks.*.attn.qkv."},
    {"backbone.encoder.layer.*.attention.attention.key.", "pretrained.blocks.*.attn.qkv."},
    {"backbone.encoder.layer.*.attention.attention.value.", "pretrained.blocks.*.attn.qkv."},
    {"backbone.encoder.layer.*.attention.output.dense.", "pretrained.blocks.*.attn.proj."},
    {"backbone.encoder.layer.*.layer_scale1.lambda1", "pretrained.blocks.*.ls1.gamma"},
    {"backbone.encoder.layer.*.layer_scale2.lambda1", "pretrained.blocks.*.ls2.gamma"},
    {"backbone.encoder.layer.*.", "pretrained.blocks.*."},
    {"backbone.embeddings.position_embeddings", "pretrained.pos_embed"},
    {"backbone.embeddings.patch_embeddings.projection.", "pretrained.patch_embed.proj."},
    {"backbone.embeddings.", "pretrained."},
    {"backbone.layernorm.", "pretrained.norm."},
    {"neck.reassemble_stage.layers.*.projection.", "depth_head.projects.*."},
    {"neck.reassemble_stage.layers.*.resize.", "depth_head.resize_layers.*."},
    {"neck.convs.*.", "depth_head.scratch.layer*_rn.", 1},
    {"neck.fusion_stage.layers.*.projection.", "depth_head.scratch.refinenet*.out_conv.", 4, -1},
    {"neck.fusion_stage.layers.*.residual_layer1.convolution1.",
     "depth_head.scratch.refinenet*.resConfUnit1.conv1.", 4, -1},
    {"neck.fusion_stage.layers.*.residual_layer1.convolution2.",
     "depth_head.scratch.refinenet*.resConfUnit1.conv2.", 4, -1},
    {"neck.fusion_stage.layers.*.residual_layer2.convolution1.",
     "depth_head.scratch.refinenet*.resConfUnit2.conv1.", 4, -1},
    {"neck.fusion_stage.layers.*.residual_layer2.convolution2.",
     "depth_head.scratch.refinenet*.resConfUnit2.conv2.", 4, -1},
    {"head.conv1.", "depth_head.scratch.output_conv1."},
    {"head.conv2.", "depth_head.scratch.output_conv2.0."},
    {"head.conv3.", "depth_head.scratch.output_conv2.2."},
};

/// The name that a rule makes of one that it fits.
std::optional<std::string> renamed(std::string_view name, const Rule& rule) {
  const std::string_view before = rule.theirs.substr(0, rule.theirs.find('*'));
  if (!name.starts_with(before)) return std::nullopt;
  std::string_view rest = name.substr(before.size());
  std::string result(rule.authors.substr(0, rule.authors.find('*')));
  if (before.size() < rule.theirs.size()) {
    constexpr std::size_t kDigits = 3;  // more blocks than any network has, and no overflow
    int number = 0;
    const std::string_view digits = rest.substr(0, kDigits);
    const auto [end, failure] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
    if (failure != std::errc() || number < 0) return std::nullopt;
    rest.remove_prefix(static_cast<std::size_t>(end - digits.data()));
    const std::string_view after = rule.theirs.substr(before.size() + 1);
    if (!rest.starts_with(after)) return std::nullopt;
    rest.remove_prefix(after.size());
    result += std::to_string(rule.first + rule.step * number);
    result += rule.authors.substr(rule.authors.find('*') + 1);
  }
  return result.append(rest);
}

/// A name in the file, what becomes of it, and the rule (std::size(kRules): none, it stays).
struct Renaming {
  std::string name;
  std::size_t rule;
};
Renaming authors_name(const std::string& name) {
  for (std::size_t i = 0; i < std::size(kRules); ++i)
    if (auto result = renamed(name, kRules[i])) return {*std::move(result), i};
  return {name, std::size(kRules)};
}

/// Another reader's tensors by the authors' names.
class AuthorsNames : public WeightReader {
 public:
  explicit AuthorsNames(std::unique_ptr<WeightReader> reader) : reader_(std::move(reader)) {
    std::map<std::string, std::size_t> index;
    for (std::size_t i = 0; i < reader_->tensors().size(); ++i) {
      const Renaming renaming = authors_name(reader_->tensors()[i].name);
      const auto [at, fresh] = index.emplace(renaming.name, sources_.size());
      if (fresh) sources_.emplace_back();
      sources_[at->second].push_back({renaming.rule, i});
      if (fresh) {
        tensors_.push_back(reader_->tensors()[i]);
        tensors_.back().name = renaming.name;
      }
    }
    for (std::size_t t = 0; t < tensors_.size(); ++t) join(t);
  }
  [[nodiscard]] const std::string& path() const override { return reader_->path(); }
  [[nodiscard]] std::string format() const override { return reader_->format(); }
  [[nodiscard]] const std::vector<TensorInfo>& tensors() const override { return tensors_; }
  [[nodiscard]] const Metadata& metadata() const override { return reader_->metadata(); }
  [[nodiscard]] bool has_checksums() const override { return reader_->has_checksums(); }
  void for_each_block(std::size_t i, const Take& take) const override {
    for (const Source& source : sources_[i]) reader_->for_each_block(source.tensor, take);
  }

 private:
  struct Source {
    std::size_t rule, tensor;
  };
  /// Puts a tensor's parts in order and adds up their first axes.
  void join(std::size_t t) {
    std::vector<Source>& parts = sources_[t];
    std::ranges::sort(parts, {}, &Source::rule);
    if (parts.size() == 1 && parts[0].rule >= kParts) return;
    for (std::size_t k = 0; k < parts.size(); ++k)
      if (parts.size() != kParts || parts[k].rule != k)
        throw Error(ErrorKind::kBadWeights,
                    reader_->path() + ": " + tensors_[t].name +
                        ": what it is made of is incomplete, or there is more than one");
    std::int64_t rows = 0;
    std::vector<std::int64_t> extents;
    for (const Source& part : parts) {
      const TensorInfo& info = reader_->tensors()[part.tensor];
      std::vector<std::int64_t> own(info.shape.extents().begin(), info.shape.extents().end());
      if (own.empty())
        throw Error(ErrorKind::kBadWeights, reader_->path() + ": " + info.name + " is a single number");
      rows += std::exchange(own[0], 0);
      if (!extents.empty() && (own != extents || info.dtype != tensors_[t].dtype))
        throw Error(ErrorKind::kBadWeights,
                    reader_->path() + ": " + info.name + " has another type or shape than its block's query");
      extents = std::move(own);
      tensors_[t].dtype = info.dtype;
    }
    extents[0] = rows;
    tensors_[t].shape = Shape(std::span<const std::int64_t>(extents));
  }

  std::unique_ptr<WeightReader> reader_;
  std::vector<TensorInfo> tensors_;
  std::vector<std::vector<Source>> sources_;  // of each tensor
};

}  // namespace

bool has_transformers_names(const WeightReader& reader) {
  const auto any = [&](std::string_view start) {
    return std::ranges::any_of(reader.tensors(),
                               [&](const TensorInfo& info) { return info.name.starts_with(start); });
  };
  return any("backbone.encoder.layer.") && any("neck.reassemble_stage.layers.");
}

std::unique_ptr<WeightReader> with_authors_names(std::unique_ptr<WeightReader> reader) {
  return std::make_unique<AuthorsNames>(std::move(reader));
}

}  // namespace slide
