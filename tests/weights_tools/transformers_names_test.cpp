#include "weights_tools/transformers_names.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "graphs/catalogue.h"
#include "graphs/formula_weights.h"
#include "runtime/error.h"
#include "runtime/safetensors_writer.h"
#include "tests/temporary_folder.h"
#include "tests/weights_tools/list.h"
#include "weights_tools/convert.h"

using namespace slide;
using slide::test::List;
using slide::test::parameters_of;

namespace {

using Tensors = std::vector<std::pair<std::string, Tensor>>;

bool replace(std::string& text, std::string_view part, std::string_view by) {
  const std::size_t at = text.find(part);
  if (at == std::string::npos) return false;
  text.replace(at, part.size(), by);
  return true;
}

/// The library's name of one of the authors' (of qkv: that of the query), word by word.
std::string library_name(std::string name) {
  if (replace(name, "pretrained.blocks.", "backbone.encoder.layer.")) {
    replace(name, "attn.proj", "attention.output.dense");
    replace(name, "attn.qkv", "attention.attention.query");
    replace(name, "ls1.gamma", "layer_scale1.lambda1");
    replace(name, "ls2.gamma", "layer_scale2.lambda1");
    return name;
  }
  if (replace(name, "pretrained.norm", "backbone.layernorm")) return name;
  if (replace(name, "pretrained.patch_embed.proj", "backbone.embeddings.patch_embeddings.projection"))
    return name;
  if (replace(name, "pretrained.pos_embed", "backbone.embeddings.position_embeddings")) return name;
  if (replace(name, "pretrained.", "backbone.embeddings.")) return name;
  for (int level = 0; level < 4; ++level) {
    const std::string n = std::to_string(level);
    const std::string after = std::to_string(level + 1);
    const std::string stage = "neck.reassemble_stage.layers." + n;
    if (replace(name, "depth_head.projects." + n, stage + ".projection")) return name;
    if (replace(name, "depth_head.resize_layers." + n, stage + ".resize")) return name;
    if (replace(name, "depth_head.scratch.layer" + after + "_rn", "neck.convs." + n)) return name;
    const std::string fusion = "neck.fusion_stage.layers." + std::to_string(3 - level);
    if (!replace(name, "depth_head.scratch.refinenet" + after, fusion)) continue;
    replace(name, "out_conv", "projection");
    replace(name, "resConfUnit", "residual_layer");
    replace(name, ".conv1", ".convolution1");
    replace(name, ".conv2", ".convolution2");
    return name;
  }
  if (replace(name, "depth_head.scratch.output_conv1", "head.conv1")) return name;
  if (replace(name, "depth_head.scratch.output_conv2.0", "head.conv2")) return name;
  replace(name, "depth_head.scratch.output_conv2.2", "head.conv3");
  return name;
}

/// The parameters as a file of the library's lists them: sorted by name, qkv in three.
std::vector<TensorInfo> library_list(const std::vector<TensorInfo>& authors) {
  std::vector<TensorInfo> list;
  for (const TensorInfo& info : authors) {
    TensorInfo own{library_name(info.name), info.dtype, info.shape};
    if (info.name.find("attn.qkv") == std::string::npos) {
      list.push_back(own);
      continue;
    }
    own.shape = own.shape.with(0, own.shape[0] / 3);
    for (const char* part : {"query", "key", "value"}) {
      list.push_back(own);
      replace(list.back().name, "query", part);
    }
  }
  std::ranges::sort(list, {}, &TensorInfo::name);
  return list;
}

std::string message_of(const auto& action) {
  try {
    action();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

Tensor numbers(const std::string& name, const Shape& shape) {
  Tensor tensor(DType::kF32, shape);
  std::uint64_t i = 0;
  for (float& value : tensor.mutable_data<float>())
    value = static_cast<float>(graphs::formula_unit(name, ++i));
  return tensor;
}

}  // namespace

TEST_CASE("Depth Anything V2 is recognised under the transformers library's names") {
  for (const char* model : {"depth_anything_v2_vits", "depth_anything_v2_vitb", "depth_anything_v2_vitl"}) {
    const std::vector<TensorInfo> authors = parameters_of(model);
    std::vector<TensorInfo> theirs = library_list(authors);
    CHECK(detect_model(List(theirs)).model.empty());
    theirs.push_back({"backbone.embeddings.mask_token", DType::kF32, {1, authors[0].shape[2]}});
    theirs.push_back({"neck.fusion_stage.layers.0.residual_layer1.convolution1.bias", DType::kF32, {64}});
    CHECK(!has_transformers_names(List(authors)));
    REQUIRE(has_transformers_names(List(theirs)));
    const auto reader = with_authors_names(std::make_unique<List>(theirs));
    CHECK(reader->tensors().size() == authors.size() + 2);
    const Detection found = detect_model(*reader);
    CHECK(found.model == model);
    CHECK(found.detail.empty());
  }
}

TEST_CASE("query, key and value become one tensor, in this order, and every other keeps its values") {
  const TemporaryFolder folder;
  const auto layer = [](const std::string& part) { return "backbone.encoder.layer.11." + part; };
  const std::array<std::string, 3> parts{layer("attention.attention.query.weight"),
                                         layer("attention.attention.key.weight"),
                                         layer("attention.attention.value.weight")};
  Tensors tensors;
  for (const std::string& part : parts) tensors.emplace_back(part, numbers(part, {4, 4}));
  const std::string other = "neck.reassemble_stage.layers.3.resize.weight";
  tensors.emplace_back(other, numbers(other, {2, 3}));
  write_safetensors(folder.file("theirs"), tensors);
  const auto reader = with_authors_names(open_weights(folder.file("theirs")));
  convert(*reader, folder.file("ours"), {.model = "any"});

  const SafetensorsFile file = SafetensorsFile::open(folder.file("ours"));
  REQUIRE(file.tensors().size() == 2);
  const Tensor qkv = file.tensor("pretrained.blocks.11.attn.qkv.weight");
  REQUIRE(qkv.shape() == Shape{12, 4});
  for (std::size_t k = 0; k < 3; ++k)
    for (std::size_t i = 0; i < 16; ++i)
      CHECK(qkv.data<float>()[16 * k + i] == static_cast<float>(graphs::formula_unit(parts[k], i + 1)));
  const Tensor resize = file.tensor("depth_head.resize_layers.3.weight");
  REQUIRE(resize.shape() == Shape{2, 3});
  for (std::size_t i = 0; i < 6; ++i)
    CHECK(resize.data<float>()[i] == static_cast<float>(graphs::formula_unit(other, i + 1)));
}

TEST_CASE("parts of an attention that are missing, doubled or of another shape are refused by name") {
  const auto refusal = [](const std::vector<TensorInfo>& list) {
    return message_of([&] { (void)with_authors_names(std::make_unique<List>(list, "model.safetensors")); });
  };
  const std::string start = "backbone.encoder.layer.3.attention.attention.";
  const TensorInfo query{start + "query.bias", DType::kF32, {4}};
  const TensorInfo key{start + "key.bias", DType::kF32, {4}};
  const TensorInfo value{start + "value.bias", DType::kF32, {4}};
  CHECK(refusal({query, key, value}) == "no error");
  for (const std::vector<TensorInfo>& list :
       {std::vector<TensorInfo>{query, key},
        {value},
        {query, key, value, {"pretrained.blocks.3.attn.qkv.bias", DType::kF32, {12}}}})
    CHECK(refusal(list).find("model.safetensors: pretrained.blocks.3.attn.qkv.bias: what it is made of") ==
          0);
  CHECK(refusal({query, key, {value.name, DType::kF32, {4, 1}}}).find(value.name + " has another") !=
        std::string::npos);
  CHECK(refusal({query, {key.name, DType::kF16, {4}}, value}).find(key.name + " has another") !=
        std::string::npos);
  CHECK(refusal({{query.name, DType::kF32, {}}, key, value}).find("is a single number") != std::string::npos);
  CHECK(refusal({{"head.conv1.bias", DType::kF32, {1}},
                 {"depth_head.scratch.output_conv1.bias", DType::kF32, {1}}})
            .find("or there is more than one") != std::string::npos);
  CHECK(refusal({{"backbone.encoder.layer.99999999999.norm1.bias", DType::kF32, {4}},
                 {"backbone.encoder.layer.-1.norm1.bias", DType::kF32, {4}}}) == "no error");
}
