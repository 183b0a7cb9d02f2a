#include "runtime/fast_executor.h"

#include <doctest/doctest.h>

#include <cmath>
#include <filesystem>

#include "runtime/error.h"
#include "runtime/reference_executor.h"
#include "runtime/safetensors.h"
#include "runtime/safetensors_writer.h"
#include "tests/runtime/sum_op.h"
#include "tests/temporary_folder.h"

using namespace slide;
using slide::test::sum;

namespace {

/// y = x doubled `depth` times, plus a constant made from weights only.
void build(Graph& g, int depth) {
  const Value w = g.parameter("w", {4});
  const Value folded = sum(sum(w, w), w);
  Value x = g.input("x", {4});
  for (int i = 0; i < depth; ++i) x = sum(x, x);
  g.tap("doubled", x);
  g.output("y", sum(x, folded));
}

WeightMap weights() {
  WeightMap map;
  const float w[] = {1, 2, 3, 0.1F};
  map.set("w", Tensor::from<float>({4}, w));
  return map;
}

const float kX[] = {1, -1, 0.5F, 0.25F};

}  // namespace

TEST_CASE("the plan folds what depends on weights only and uses memory again") {
  Graph g;
  build(g, 10);
  const Plan plan = make_plan(g, Isa::kBaseline);
  CHECK(plan.steps.size() == 11);
  CHECK(plan.arena_bytes == 3 * 64);  // input, result and scratch of one step at a time
  CHECK(plan.weight_bytes == 16);     // the folded sum, not w itself
  CHECK(make_plan(g, Isa::kBaseline, true).arena_bytes >= 11 * 64);
}

TEST_CASE("fast and reference executors agree, and a second run gives the same") {
  Graph g;
  build(g, 3);
  FastExecutor fast(g, weights());
  ReferenceExecutor reference(g, weights());
  const NamedTensors inputs = {{"x", Tensor::from<float>({4}, kX)}};
  reference.run(inputs);
  for (int round = 0; round < 2; ++round) {
    fast.run(inputs);
    CHECK(max_abs_difference(fast.tensor("y"), reference.tensor("y")) < 1e-6);
  }
  CHECK_THROWS_AS((void)fast.tensor("doubled"), Error);
}

TEST_CASE("executors share a workspace, as large as the largest needs, also after it was given back") {
  Graph small, large;
  build(small, 2);
  Value x = large.input("x", {1000});
  large.output("y", sum(x, x));
  const auto workspace = std::make_shared<Workspace>();
  FastExecutor first(small, weights(), {.workspace = workspace});
  CHECK(workspace->bytes() == first.plan().arena_bytes);
  const NamedTensors inputs = {{"x", Tensor::from<float>({4}, kX)}};
  first.run(inputs);
  const Tensor expected = first.tensor("y").clone();
  CHECK(expected.data<float>()[0] == 7);  // 4·1 + 3·1
  FastExecutor second(large, weights(), {.workspace = workspace});
  CHECK(workspace->bytes() == second.plan().arena_bytes);
  CHECK(workspace->bytes() > first.plan().arena_bytes);
  CHECK_THROWS_AS((void)first.tensor("y"), Error);  // lost
  const std::vector<float> ones(1000, 1);
  for (int round = 0; round < 3; ++round) {
    second.run({{"x", Tensor::from<float>({1000}, ones)}});
    CHECK(second.tensor("y").data<float>()[999] == 2);
    first.run(inputs);
    CHECK(max_abs_difference(first.tensor("y"), expected) == 0);
    if (round == 1) workspace->release();
  }
  CHECK(workspace->bytes() == second.plan().arena_bytes);
}

TEST_CASE("weights that are damaged or not finite are refused by name when they are loaded") {
  Graph g;
  build(g, 1);
  const auto message_of = [&](const WeightSource& source) -> std::string {
    try {
      const FastExecutor fast(g, source);
    } catch (const Error& e) {
      CHECK(e.kind() == ErrorKind::kBadWeights);
      return e.what();
    }
    return "no error";
  };
  const TemporaryFolder folder;
  for (const float last : {0.1F, INFINITY, -INFINITY, NAN}) {
    const float w[] = {1, 2, 3, last};
    WeightMap map("here");
    map.set("w", Tensor::from<float>({4}, w));
    write_safetensors(folder.file("w"), {{"w", *map.find("w", {})}});
    if (std::isfinite(last)) {
      CHECK(message_of(map) == "no error");
      CHECK(message_of(SafetensorsWeights(folder.file("w"))) == "no error");
    } else {
      CHECK(message_of(map) == "here: tensor w: element 3 is not a finite number");
      CHECK(message_of(SafetensorsWeights(folder.file("w"))).find("w: tensor w: element 3 is not a finite") !=
            std::string::npos);
      CHECK_THROWS_AS(ReferenceExecutor(g, map), Error);
    }
  }
  write_safetensors(folder.file("w"), {{"w", *weights().find("w", {})}});
  flip_bit(folder.file("w"), 8 * std::filesystem::file_size(folder.file("w")) - 9);
  CHECK(message_of(SafetensorsWeights(folder.file("w")))
            .find("tensor w: its data does not match its checksum") != std::string::npos);
}

TEST_CASE("keep_all hands out every tensor") {
  Graph g;
  build(g, 3);
  FastExecutor fast(g, weights(), {.isa = Isa::kBaseline, .keep_all = true});
  fast.run({{"x", Tensor::from<float>({4}, kX)}});
  CHECK(fast.tensor("doubled").data<float>()[0] == 8.0F);
  CHECK(fast.tensor("sum_3").data<float>()[0] == 2.0F);
}

TEST_CASE("a plan over the memory limit is refused with both numbers") {
  Graph g;
  const Value x = g.input("x", {1 << 20});
  g.output("y", sum(x, x));
  try {
    const FastExecutor fast(g, WeightMap(), {.isa = Isa::kBaseline, .memory_limit = 1 << 20});
    FAIL("no error");
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kOutOfMemory);
    CHECK(std::string(e.what()).find("needs 8 MiB") != std::string::npos);
    CHECK(std::string(e.what()).find("limit of 1 MiB") != std::string::npos);
  }
}

TEST_CASE("wrong inputs are errors that name the input") {
  Graph g;
  build(g, 1);
  FastExecutor fast(g, weights());
  CHECK_THROWS_WITH_AS(fast.run({}), "the input x was not given", Error);
  CHECK_THROWS_WITH_AS(fast.run({{"x", Tensor::zeros(DType::kF32, {5})}}),
                       "the input x has the shape 5, the graph was built for 4", Error);
}

TEST_CASE("the profile names kernels and counts bytes") {
  Graph g;
  build(g, 1);
  FastExecutor fast(g, weights());
  Profile profile;
  RunOptions options;
  options.profile = &profile;
  fast.run({{"x", Tensor::from<float>({4}, kX)}}, options);
  REQUIRE(profile.size() == 2);
  CHECK(profile[0].kernel == "sum.plain.baseline");
  CHECK(profile[0].bytes == 48);
}

TEST_CASE("large weights are folded in float64 and rounded once, some rows at a time") {
  const Shape shape{301, 100};  // four slabs, the last one smaller
  Graph g;
  const Value w = g.parameter("w", shape);
  const Value v = g.parameter("v", shape);
  g.output("y", sum(g.input("x", shape), sum(sum(w, v), w)));
  Tensor big(DType::kF32, shape);
  Tensor small(DType::kF64, shape);
  for (std::size_t i = 0; i < static_cast<std::size_t>(shape.count()); ++i) {
    big.mutable_data<float>()[i] = static_cast<float>(i + 1);
    small.mutable_data<double>()[i] = static_cast<double>(i + 1) * 0x1p-25;
  }
  WeightMap map;
  map.set("w", big);
  map.set("v", small);
  FastExecutor fast(g, map);
  fast.run({{"x", Tensor::zeros(DType::kF32, shape)}});
  const Tensor result = fast.tensor("y");
  const std::span<const float> y = result.data<float>();
  for (std::size_t i = 0; i < y.size(); ++i)
    REQUIRE(y[i] == static_cast<float>(static_cast<double>(i + 1) * (2 + 0x1p-25)));
}
