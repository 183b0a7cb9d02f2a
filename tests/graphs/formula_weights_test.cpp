#include "graphs/formula_weights.h"

#include <doctest/doctest.h>

#include <cmath>

#include "graphs/catalogue.h"
#include "runtime/threads.h"
#include "tests/graphs/network_support.h"

using namespace slide;
using namespace slide::graphs;

TEST_CASE("the formula gives the published numbers") {
  // Printed by the Python program that comes with the golden files.
  CHECK(formula_unit("a", 1) == -0.25653815269470215);
  CHECK(formula_unit("a", 2) == 0.9962445497512817);
  CHECK(formula_unit("a", 3) == 0.9842129945755005);
}

TEST_CASE("a golden file's filter banks are the formula times the scale, the rest its own tensors") {
  const Golden golden = golden_file("inpaint_deepfill");
  const FormulaWeights weights = golden.weights();
  const std::string name = "stage2.contextual_attention.fuse_weight";
  const auto kernel = weights.find(name, {1, 1, 3, 3});
  REQUIRE(kernel.has_value());
  for (std::size_t i = 0; i < 9; ++i)
    CHECK(kernel->data<float>()[i] ==
          static_cast<float>(formula_unit(name, i + 1)) * static_cast<float>(0.8164966106414795));
  const auto bias = weights.find("stage1.conv1.conv.bias", {48});
  REQUIRE(bias.has_value());
  CHECK(bias->shape() == Shape{48});
  CHECK_FALSE(weights.find("stage3.conv1.conv.weight", {1, 1, 1, 1}).has_value());
  CHECK_FALSE(weights.find("stage1.conv1.conv.weight", {48}).has_value());
}

TEST_CASE("formula weights do not depend on the number of threads") {
  const FormulaWeights weights = FormulaWeights::made_up("salt");
  const Shape shape{64, 64, 7, 7};  // several blocks
  set_thread_count(1);
  const Tensor one = *weights.find("w", shape);
  set_thread_count(4);
  const Tensor four = *weights.find("w", shape);
  set_thread_count(0);
  CHECK(max_abs_difference(one, four) == 0);
  CHECK(max_abs(one) <= std::sqrt(6.0 / (64 * 49)) * (1 + 1e-7));
  CHECK(max_abs(one) > 0.999 * std::sqrt(6.0 / (64 * 49)));
}

TEST_CASE("made-up weights serve every parameter of every model") {
  const FormulaWeights weights = FormulaWeights::made_up();
  for (const Model& model : catalogue()) {
    if (model.name == "midas_v21" || model.name == "u2net" || model.name == "fba" ||
        model.name == "depth_anything_v2_vitb" || model.name == "depth_anything_v2_vitl")
      continue;  // many numbers, same kinds
    const std::int64_t side = model.size.multiple == 14 ? 28 : 32;
    const auto graph = build_model(model.name, {.height = side, .width = side});
    CHECK(fit(*graph, weights).usable());
  }
  const Tensor fuse = *weights.find("stage2.contextual_attention.fuse_weight", {1, 1, 3, 3});
  for (std::size_t i = 0; i < 9; ++i) CHECK(fuse.data<float>()[i] == (i % 4 == 0 ? 1.0F : 0.0F));
  CHECK(weights.find("bn.running_var", {2})->data<float>()[1] == 1.0F);
  CHECK(weights.find("bn.running_mean", {2})->data<float>()[1] == 0.0F);
  CHECK(weights.find("bn.weight", {2})->data<float>()[0] >= 0.9F);
}
