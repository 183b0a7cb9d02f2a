#include "runtime/error_model.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "runtime/calibration.h"
#include "runtime/error.h"
#include "tests/runtime/sum_op.h"

using namespace slide;
using slide::test::sum;

namespace {

std::string problem(const std::string& text) {
  try {
    (void)parse_calibration(text, "file.safetensors");
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadWeights);
    return e.what();
  }
  return "";
}

std::string layer(const std::string& entry) {
  return R"({"version":1,"layers":{"conv.weight":)" + entry + "}}";
}

bool refuses(std::string_view name, std::optional<double> budget) {
  try {
    (void)precision_choice(name, budget);
  } catch (const Error& e) {
    return e.kind() == ErrorKind::kUsage;
  }
  return false;
}

}  // namespace

TEST_CASE("an error arrives at the output by all paths, halved where two tensors are added") {
  Graph g;
  const Value x = g.input("x", {4});
  const Value a = sum(x, x);  // both summands are the same: all of its error
  const Value b = sum(a, x);
  const Value w = g.parameter("w", {4});
  const Value c = sum(b, w);
  g.output("c", c);
  const Value unused = sum(a, a);
  std::vector<bool> constant(g.nodes().size(), false);
  constant[static_cast<std::size_t>(w.node())] = true;
  const std::vector<double> shares = error_shares(g, constant);
  const auto share = [&](Value v) { return shares[static_cast<std::size_t>(v.node())]; };
  CHECK(share(c) == 1);
  CHECK(share(b) == 0.5);
  CHECK(share(w) == 0);
  CHECK(share(a) == 0.25);
  CHECK(share(x) == 0.5);  // 1/4 by b and 1/4 by a
  CHECK(share(unused) == 0);
}

TEST_CASE("the ends of a network are its first layer and its last") {
  Graph g;
  Value x = g.input("x", {4});
  std::vector<bool> low{false};
  for (int i = 0; i < 5; ++i) x = sum(x, x);
  g.output("y", x);
  low.resize(g.nodes().size(), true);
  CHECK(network_ends(g, low) == std::vector<bool>{false, true, false, false, false, true});
  // Two layers are ends, all of them: so none is.
  low = {false, true, false, false, false, true};
  CHECK(network_ends(g, low) == std::vector<bool>(6, false));
}

TEST_CASE("the choices within a limit are those that save the most for their error") {
  const std::vector<std::vector<KernelChoice>> choices = {
      {{nullptr, 0, 10}, {nullptr, 4, 2}},                   // saves 2 for each square
      {{nullptr, 0, 10}, {nullptr, 1, 1}, {nullptr, 9, 0}},  // 9, then an eighth
      {{nullptr, 0, 5}, {nullptr, 0, 3}},                    // free
      {{nullptr, 0, 5}, {nullptr, 1, 9}},                    // worse in both
  };
  using Chosen = std::vector<std::size_t>;
  CHECK(choose_within(choices, 0) == Chosen{0, 0, 1, 0});
  CHECK(choose_within(choices, 1) == Chosen{0, 1, 1, 0});
  CHECK(choose_within(choices, 4.5) == Chosen{0, 1, 1, 0});
  CHECK(choose_within(choices, 5) == Chosen{1, 1, 1, 0});
  CHECK(choose_within(choices, 100) == Chosen{1, 2, 1, 0});
}

TEST_CASE("what users say about precision is understood or refused") {
  CHECK(precision_choice("", {}).precision == Precision::kFp32);
  CHECK(precision_choice("", {}).error_budget == 0);
  CHECK(precision_choice("bf16", {}).precision == Precision::kBf16);
  CHECK(precision_choice("bf16", 1e-3).error_budget == 1e-3);
  CHECK(precision_choice("auto", {}).precision == Precision::kInt8);
  CHECK(precision_choice("auto", {}).error_budget == kDefaultErrorBudget);
  CHECK(precision_choice("", 0.1).precision == Precision::kInt8);
  CHECK(refuses("fp64", {}));
  CHECK(refuses("fp32", 0));
  CHECK(refuses("auto", -1));
  CHECK(refuses("auto", 1.01));
  CHECK(refuses("auto", std::numeric_limits<double>::quiet_NaN()));
}

TEST_CASE("a calibration is read as it was written") {
  Calibration calibration;
  calibration.layers["a.weight"] = {{-0.1F, 3.3F}, 1.0 / 3};
  calibration.layers["b.weight"] = {{0, 6}, 0};
  const Calibration read = parse_calibration(text_of(calibration), "here");
  REQUIRE(read.layers.size() == 2);
  CHECK(read.layers.at("a.weight").range.low == -0.1F);
  CHECK(read.layers.at("a.weight").range.high == 3.3F);
  CHECK(read.layers.at("a.weight").error == 1.0 / 3);
  CHECK(read.layers.at("b.weight").range.high == 6);
}

TEST_CASE("a broken calibration is refused, naming the file and what is wrong") {
  CHECK(problem(layer(R"({"range":[-1,2],"error":0.1})")).empty());
  const std::vector<std::pair<std::string, std::string>> broken = {
      {"", "is no JSON object"},
      {"[1", "is no JSON object"},
      {"[]", "is no JSON object"},
      {"{}", "has no version"},
      {R"({"version":2,"layers":{}})", "version that this program does not know"},
      {R"({"version":"1","layers":{}})", "version that this program does not know"},
      {R"({"version":1})", "has no layers"},
      {R"({"version":1,"layers":[]})", "lists no layers"},
      {layer("3"), "of layer conv.weight is no object"},
      {layer(R"({"error":0})"), "conv.weight has no range"},
      {layer(R"({"range":[0,1]})"), "conv.weight has no error"},
      {layer(R"({"range":[0,1,2],"error":0})"), "is no pair"},
      {layer(R"({"range":[0,"1"],"error":0})"), "is no number"},
      {layer(R"({"range":[0,1e39],"error":0})"), "is no number"},
      {layer(R"({"range":[0,1e999],"error":0})"), ""},
      {layer(R"({"range":[0,null],"error":0})"), "is no number"},
      {layer(R"({"range":[1,2],"error":0})"), "does not hold zero"},
      {layer(R"({"range":[1,-1],"error":0})"), "does not hold zero"},
      {layer(R"({"range":[0,0],"error":0})"), "does not hold zero"},
      {layer(R"({"range":[0,1],"error":-1})"), "negative error"}};
  for (const auto& entry : broken) {
    CAPTURE(entry.first);
    const std::string message = problem(entry.first);
    CHECK(message.find("file.safetensors") != std::string::npos);
    CHECK(message.find(entry.second) != std::string::npos);
  }
}
