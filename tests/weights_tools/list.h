#pragma once

#include <doctest/doctest.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "graphs/catalogue.h"
#include "weights_tools/weight_reader.h"

namespace slide::test {

/// Names and shapes without a file.
class List : public WeightReader {
 public:
  List() = default;
  explicit List(std::vector<TensorInfo> tensors, std::string path = "w.pt")
      : list(std::move(tensors)), path_(std::move(path)) {}
  std::vector<TensorInfo> list;
  Metadata said;
  [[nodiscard]] const std::string& path() const override { return path_; }
  [[nodiscard]] std::string format() const override { return "list"; }
  [[nodiscard]] const std::vector<TensorInfo>& tensors() const override { return list; }
  [[nodiscard]] const Metadata& metadata() const override { return said; }
  [[nodiscard]] bool has_checksums() const override { return false; }
  void for_each_block(std::size_t /*i*/, const Take& /*take*/) const override {
    FAIL("no values are needed");
  }

 private:
  std::string path_ = "w.pt";
};

/// A model's parameters.
inline std::vector<TensorInfo> parameters_of(std::string_view model) {
  graphs::BuildOptions options;
  const std::int64_t multiple = graphs::find_model(model).size.multiple;
  options.height = options.width = (256 + multiple - 1) / multiple * multiple;
  std::vector<TensorInfo> list;
  const std::unique_ptr<Graph> graph = graphs::build_model(model, options);
  for (const Node& node : graph->nodes())
    if (node.kind == NodeKind::kParameter) list.push_back({node.name, DType::kF32, node.shape});
  return list;
}

}  // namespace slide::test
