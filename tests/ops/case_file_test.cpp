#include "ops/case_file.h"

#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include "judge.h"

using namespace slide;

namespace {

/// What build_case() says to attributes for an operator of one 1×4×5×6 input x (and a weight, and a bias).
std::string answer(const std::string& op, const std::string& attributes) {
  Graph g;
  std::vector<std::pair<std::string, Value>> inputs{{"x", g.input("x", {1, 4, 5, 6})}};
  if (op.find("conv2d") != std::string::npos) inputs.emplace_back("weight", g.input("weight", {6, 4, 3, 3}));
  try {
    (void)ops::build_case(op, attributes, inputs);
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadInput);
    return e.what();
  }
  return "";
}

bool refused(const std::string& op, const std::string& attributes, const std::string& reason) {
  const std::string message = answer(op, attributes);
  INFO(op, " ", attributes, ": ", message);
  CHECK(message.find(reason) != std::string::npos);
  return message.find(reason) != std::string::npos;
}

}  // namespace

TEST_CASE("every operator has one name, which docs/operators.md explains") {
  const std::vector<std::string> names = ops::case_operators();
  CHECK(std::set<std::string>(names.begin(), names.end()).size() == names.size());
  std::ifstream file(SLIDE_TEST_DATA "/../../docs/operators.md");
  const std::string manual{std::istreambuf_iterator<char>(file), {}};
  REQUIRE_FALSE(manual.empty());
  for (const std::string& name : names) {
    CAPTURE(name);
    CHECK(manual.find("`" + name + "`") != std::string::npos);
  }
}

TEST_CASE("sound attributes build a graph") {
  CHECK(answer("conv2d", R"({"stride": [2, 1], "padding": [1, 0, 1, 2], "dilation": [1, 2], "groups": 1})")
            .empty());
  CHECK(answer("max_pool2d", R"({"kernel": [2, 2]})").empty());
  CHECK(answer("resize", R"({"mode": "linear", "coordinates": "align_corners", "size": [7, 9]})").empty());
  CHECK(answer("clip", R"({"max": 6})").empty());
  CHECK(answer("reduce_mean", R"({"axes": [2, -1]})").empty());
  CHECK(answer("cone_dilation", R"({"rho": 0.1, "radius": 9223372036854775807})").empty());
}

TEST_CASE("unknown operators, inputs and attributes are refused by name") {
  CHECK(refused("conv3d", "{}", "no operator conv3d"));
  CHECK(refused(std::string(5000, 'a'), "{}", "no operator aaaa"));
  CHECK(refused("relu", R"({"slope": 1})", "\"slope\", which the operator does not know"));
  CHECK(refused("add", "{}", "no input \"other\""));
  CHECK(refused("concat", R"({"axis": 0})", "no input \"x0\""));
  CHECK(refused("leaky_relu", "{}", "no attribute \"slope\""));
  Graph g;
  const Value x = g.input("x", {2});
  CHECK_THROWS_AS((void)ops::build_case("relu", "{}", {{"x", x}, {"y", x}}), Error);
}

TEST_CASE("hostile attributes are refused before anything is computed") {
  CHECK(refused("relu", "", "not a JSON object"));
  CHECK(refused("relu", "[]", "not a JSON object"));
  CHECK(refused("relu", "{\"a\":", "not a JSON object"));
  CHECK(refused("relu", std::string(100000, '['), "more than 64 KiB"));
  CHECK(refused("relu", std::string(60000, '['), "not a JSON object"));
  CHECK(refused("conv2d", R"({"stride": [0, 1]})", "from 1 to"));
  CHECK(refused("conv2d", R"({"stride": [1]})", "list of 2"));
  CHECK(refused("conv2d", R"({"stride": 1})", "list of 2"));
  CHECK(refused("conv2d", R"({"stride": [1.5, 1]})", "whole numbers"));
  CHECK(refused("conv2d", R"({"stride": ["1", 1]})", "whole numbers"));
  CHECK(refused("conv2d", R"({"padding": [0, 0, 0, -1]})", "from 0 to"));
  CHECK(refused("conv2d", R"({"padding": [18446744073709551615, 0, 0, 0]})", "from 0 to"));
  CHECK(refused("conv2d", R"({"dilation": [9223372036854775807, 1]})", "from 1 to"));
  CHECK(refused("conv2d", R"({"groups": 3})", ""));
  CHECK(refused("max_pool2d", R"({"kernel": [2, 2], "ceil_mode": 1})", "true or false"));
  CHECK(refused("max_pool2d", R"({"kernel": [9, 9]})", "does not fit into 1x4x5x6"));
  CHECK(refused("resize", R"({"mode": "lanczos", "coordinates": "half_pixel", "size": [1, 1]})",
                "one of nearest"));
  CHECK(refused("resize", R"({"mode": 1, "coordinates": "half_pixel", "size": [1, 1]})", "one of nearest"));
  CHECK(refused("resize", R"({"mode": "linear", "coordinates": "half_pixel", "size": [100000, 100000]})",
                "result of shape 1x4x100000x100000"));
  CHECK(refused("resize",
                R"({"mode": "linear", "coordinates": "half_pixel", "size": [2, 2], "scale": [1e999, 1]})",
                ""));
  CHECK(refused("resize",
                R"({"mode": "linear", "coordinates": "half_pixel", "size": [2, 2], "scale": [null, 1]})",
                "finite numbers"));
  CHECK(refused("pad", R"({"padding": [16000000, 16000000, 16000000, 16000000]})", "result of shape"));
  CHECK(refused("softmax", R"({"axis": 4})", "axis 4"));
  CHECK(refused("softmax", R"({"axis": 1e18})", "whole numbers"));
  CHECK(refused("reduce_max", R"({"axes": []})", "1 to 5"));
  CHECK(refused("reduce_max", R"({"axes": [0, 1, 2, 3, 4, 0]})", "1 to 5"));
  CHECK(refused("reshape", R"({"shape": [120, 2]})", "cannot reshape"));
  CHECK(refused("gaussian_blur", R"({"sigma": 1e9})", "sigma"));
  CHECK(refused("cone_dilation", R"({"rho": -1, "radius": 3})", "rho is -1"));
  CHECK(refused("elu", R"({"alpha": 1e300})", "beyond the range"));
}
