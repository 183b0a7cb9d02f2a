#include "runtime/graph.h"

#include <doctest/doctest.h>

#include "runtime/error.h"
#include "runtime/reference_executor.h"
#include "tests/runtime/sum_op.h"

using namespace slide;
using slide::test::sum;

namespace {

std::string message_of(auto&& call) {
  try {
    call();
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace

TEST_CASE("a mismatch is found while the graph is built and names the layer and both shapes") {
  Graph g;
  const Value x = g.input("x", {2, 3});
  const Value w = g.parameter("w", {2, 4});
  const auto scope = g.scope("block1");
  const std::string message = message_of([&] { (void)sum(x, w); });
  CHECK(message.find("block1.sum") != std::string::npos);
  CHECK(message.find("2x3") != std::string::npos);
  CHECK(message.find("2x4") != std::string::npos);
}

TEST_CASE("a node may be given a name of its own, which the scope prefixes and which must be free") {
  Graph g;
  const Value x = g.input("x", {2});
  const auto scope = g.scope("block1");
  const Value named = g.add(std::make_shared<slide::test::SumOp>(), {x, x}, "both");
  CHECK(g.node(named.node()).name == "block1.both");
  CHECK(message_of([&] {
          (void)g.add(std::make_shared<slide::test::SumOp>(), {x, x}, "both");
        }).find("block1.both") != std::string::npos);
}

TEST_CASE("the reference executor hands out outputs, taps and kept nodes, and drops the rest") {
  Graph g;
  const Value x = g.input("x", {2});
  const Value w = g.parameter("w", {2});
  const Value a = sum(x, w);
  const Value b = sum(a, w);
  g.tap("middle", a);
  g.output("y", sum(b, b));
  WeightMap weights;
  const float values[] = {0.5F, 1.0F};
  weights.set("w", Tensor::from<float>({2}, values));
  ReferenceExecutor run(g, weights);
  const double in[] = {1, 2};
  run.run({{"x", Tensor::from<double>({2}, in)}}, {"middle"});
  CHECK(run.tensor("middle").data<double>()[1] == 3.0);
  CHECK(run.tensor("y").data<double>()[0] == 4.0);
  CHECK_THROWS_AS((void)run.tensor("sum_2"), Error);
}

TEST_CASE("weights that do not fit are listed in one message") {
  Graph g;
  g.parameter("a", {2});
  g.parameter("b", {3});
  g.parameter("c", {4});
  WeightMap weights("w.safetensors");
  weights.set("b", Tensor::zeros(DType::kF32, {5}));
  weights.set("c", Tensor::zeros(DType::kI64, {4}));
  weights.set("d", Tensor::zeros(DType::kF32, {1}));
  weights.set("bn.num_batches_tracked", Tensor::zeros(DType::kI64, Shape{}));
  const std::string message = message_of([&] { (void)bind(g, weights); });
  CHECK(message.find("w.safetensors: missing (1): a; wrong shape (1): b: has 5, the network needs 3; "
                     "not floating-point (1): c: I64; not used by the network (1): d") == 0);
}

TEST_CASE("a run can be cancelled from its progress callback") {
  Graph g;
  const Value x = g.input("x", {1});
  g.output("y", sum(sum(x, x), x));
  ReferenceExecutor run(g, WeightMap());
  RunOptions options;
  options.progress = [](const Progress& p) { return p.done < 2; };
  CHECK_THROWS_AS(run.run({{"x", Tensor::zeros(DType::kF32, {1})}}, {}, false, options), Error);
}
