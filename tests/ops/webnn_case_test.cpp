#include "ops/webnn/webnn_case.h"

#include <doctest/doctest.h>

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "ops/check.h"
#include "ops/check_report.h"
#include "runtime/error.h"
#include "tests/temporary_folder.h"

using namespace slide;

namespace {

std::string tensor(const std::string& shape, const std::string& data, const std::string& type = "float32") {
  return R"({"shape": )" + shape + R"(, "data": )" + data + R"(, "type": ")" + type + R"("})";
}

std::string file_of(const std::string& inputs, const std::string& others, const std::string& expected) {
  return R"({"tests": [{"name": "made here", "inputs": )" + inputs + others + R"(, "expected": )" + expected +
         "}]}";
}

ops::OperatorCase parsed(const std::string& json, std::string_view op) {
  return ops::parse_webnn_case(std::as_bytes(std::span(json)), op, 1, "here.json");
}

std::string problem(const std::string& json, std::string_view op) {
  try {
    (void)ops::check_case(parsed(json, op), Isa::kBaseline);
  } catch (const Error& e) {
    CHECK(e.kind() == ErrorKind::kBadInput);
    return e.what();
  }
  return "";
}

/// One test: operator, inputs, what stands beside them, the result, and one that is wrong.
struct Made {
  const char* op;
  std::string inputs, others, expected, wrong;
};

const std::string kOneToNine = tensor("[1, 1, 3, 3]", "[1, 2, 3, 4, 5, 6, 7, 8, 9]");

const Made kMade[] = {
    {"conv2d",
     R"({"input": )" + kOneToNine + R"(, "filter": )" + tensor("[1, 1, 2, 2]", "[1, 1, 1, 1]") + "}",
     R"(, "options": {"bias": )" + tensor("[1]", "[0.5]") + "}",
     tensor("[1, 1, 2, 2]", "[12.5, 16.5, 24.5, 28.5]"), tensor("[1, 1, 2, 2]", "[12, 16, 24, 28]")},
    // Padding is top, bottom, left, right: one row below, one column at the left.
    {"conv2d",
     R"({"input": )" + kOneToNine + R"(, "filter": )" + tensor("[1, 1, 2, 2]", "[1, 1, 1, 1]") + "}",
     R"(, "options": {"padding": [0, 1, 1, 0], "strides": [2, 2]})", tensor("[1, 1, 2, 2]", "[5, 16, 7, 17]"),
     tensor("[1, 1, 2, 2]", "[12, 9, 15, 9]")},
    // Two channels in nhwc, 1 2 3 4 and 10 20 30 40, weighted 1 and 0.5, by a filter of each layout.
    {"conv2d",
     R"({"input": )" + tensor("[1, 2, 2, 2]", "[1, 10, 2, 20, 3, 30, 4, 40]") + R"(, "filter": )" +
         tensor("[1, 1, 1, 2]", "[1, 0.5]") + "}",
     R"(, "options": {"inputLayout": "nhwc", "filterLayout": "ohwi"})",
     tensor("[1, 2, 2, 1]", "[6, 12, 18, 24]"), tensor("[1, 2, 2, 1]", "[10.5, 21, 31.5, 42]")},
    {"conv2d",
     R"({"input": )" + tensor("[1, 2, 1, 1]", "[1, 10]") + R"(, "filter": )" +
         tensor("[1, 1, 2, 3]", "[1, 2, 3, 4, 5, 6]") + "}",
     R"(, "options": {"filterLayout": "hwio"})", tensor("[1, 3, 1, 1]", "[41, 52, 63]"),
     tensor("[1, 3, 1, 1]", "[21, 43, 65]")},
    {"conv2d",
     R"({"input": )" + kOneToNine + R"(, "filter": )" + tensor("[1, 1, 2, 2]", "[1, 0, 0, 0]") + "}",
     R"(, "options": {"autoPad": "same-lower"})", tensor("[1, 1, 3, 3]", "[0, 0, 0, 0, 1, 2, 0, 4, 5]"),
     tensor("[1, 1, 3, 3]", "[1, 2, 3, 4, 5, 6, 7, 8, 9]")},
    {"average_pool2d", R"({"input": )" + kOneToNine + "}", R"(, "options": {"windowDimensions": [2, 2],
     "padding": [1, 0, 0, 0]})",
     tensor("[1, 1, 3, 2]", "[1.5, 2.5, 3, 4, 6, 7]"), tensor("[1, 1, 3, 2]", "[0.75, 1.25, 3, 4, 6, 7]")},
    {"max_pool2d", R"({"input": )" + kOneToNine + "}", "", tensor("[1, 1, 1, 1]", "[9]"),
     tensor("[1, 1, 1, 1]", "[8]")},
    {"resample2d", R"({"input": )" + tensor("[1, 1, 1, 2]", "[0, 4]") + "}",
     R"(, "options": {"mode": "linear", "sizes": [1, 4]})", tensor("[1, 1, 1, 4]", "[0, 1, 3, 4]"),
     tensor("[1, 1, 1, 4]", "[0, 2, 3, 4]")},
    {"resample2d", R"({"input": )" + tensor("[1, 1, 2, 1]", "[1, 2]") + "}",
     R"(, "options": {"axes": [1, 2], "scales": [1, 2]})", tensor("[1, 1, 4, 1]", "[1, 1, 2, 2]"),
     tensor("[1, 1, 4, 1]", "[1, 2, 2, 2]")},
    {"batch_normalization",
     R"({"input": )" + tensor("[1, 2, 1, 1]", "[3, 5]") + R"(, "mean": )" + tensor("[2]", "[1, 1]") +
         R"(, "variance": )" + tensor("[2]", "[3, 15]") + "}",
     R"(, "options": {"epsilon": 1, "scale": )" + tensor("[2]", "[2, 4]") + "}",
     tensor("[1, 2, 1, 1]", "[2, 4]"), tensor("[1, 2, 1, 1]", "[1, 1]")},
    {"clamp", R"({"x": )" + tensor("[3]", "[-2, 0.5, 2]") + "}",
     R"(, "options": {"minValue": -1, "maxValue": 1})", tensor("[3]", "[-1, 0.5, 1]"),
     tensor("[3]", "[-2, 0.5, 1]")},
    {"concat", "[" + tensor("[1, 2]", "[1, 2]") + ", " + tensor("[1, 1]", "3") + "]", R"(, "axis": 1)",
     tensor("[1, 3]", "[1, 2, 3]"), tensor("[1, 3]", "[1, 3, 2]")},
    {"pad", R"({"x": )" + tensor("[1, 1, 1, 3]", "[1, 2, 3]") + "}",
     R"(, "beginningPadding": [0, 0, 0, 2], "endingPadding": [0, 0, 0, 0], "options": {"mode": "reflection"})",
     tensor("[1, 1, 1, 5]", "[3, 2, 1, 2, 3]"), tensor("[1, 1, 1, 5]", "[1, 1, 1, 2, 3]")},
    {"reduce_mean", R"({"x": )" + tensor("[2, 2]", "[1, 2, 3, 6]") + "}",
     R"(, "options": {"axes": [1], "keepDimensions": true})", tensor("[2, 1]", "[1.5, 4.5]"),
     tensor("[2, 1]", "[2, 4]")},
    {"leaky_relu", R"({"x": )" + tensor("[2]", "[-4, 4]") + "}", R"(, "options": {"alpha": 0.25})",
     tensor("[2]", "[-1, 4]"), tensor("[2]", "[-0.04, 4]")},
    {"linear", R"({"x": )" + tensor("[2]", "[1, 2]") + "}", R"(, "options": {"alpha": 2, "beta": -1})",
     tensor("[2]", "[1, 3]"), tensor("[2]", "[2, 4]")},
    {"softmax", R"({"x": )" + tensor("[2, 2]", "[0, 0, 7, 7]") + "}", "",
     tensor("[2, 2]", "[0.5, 0.5, 0.5, 0.5]"), tensor("[2, 2]", "[0, 0, 1, 1]")},
    {"sub", R"({"a": )" + tensor("[2]", "[1, 2]") + R"(, "b": )" + tensor("[]", "3") + "}", "",
     tensor("[2]", "[-2, -1]"), tensor("[2]", "[2, 1]")},
    {"min", R"({"a": )" + tensor("[2]", "[1, 5]") + R"(, "b": )" + tensor("[2]", "[3, 4]") + "}", "",
     tensor("[2]", "[1, 4]"), tensor("[2]", "[3, 5]")},
    {"abs", R"({"x": )" + tensor("[2]", "[-1, 2]") + "}", "", tensor("[2]", "[1, 2]"),
     tensor("[2]", "[-1, 2]")},
};

}  // namespace

TEST_CASE("WebNN's tests are read as operator cases, and a wrong result is seen") {
  for (const Made& made : kMade) {
    const std::string json = file_of(made.inputs, made.others, made.expected);
    CAPTURE(json);
    CHECK(ops::check_case(parsed(json, made.op), detected_isa()).passed());
    const ops::OperatorCase wrong = parsed(file_of(made.inputs, made.others, made.wrong), made.op);
    CHECK_FALSE(ops::check_case(wrong, Isa::kBaseline).reference_passed());
  }
}

TEST_CASE("a WebNN test that is damaged, or none of ours, is refused by name") {
  const std::string x = R"({"x": )" + tensor("[2]", "[1, 2]") + "}";
  const std::string y = tensor("[2]", "[1, 2]");
  struct Bad {
    const char* op;
    std::string json, says;
  };
  const std::string image =
      R"({"x": )" + kOneToNine + R"(, "filter": )" + tensor("[1, 1, 2, 2]", "[1, 1, 1, 1]") + "}";
  const Bad bad[] = {
      {"abs", "", "no list \"tests\""},
      {"abs", "[]", "no list \"tests\""},
      {"abs", R"({"tests": {}})", "no list \"tests\""},
      {"abs", std::string(100000, '['), "no list \"tests\""},
      {"abs", R"({"tests": [)" + std::string(60, '[') + std::string(60, ']') + "]}", "no list \"tests\""},
      {"abs", R"({"tests": []})", "there is no test 1"},
      {"abs", R"({"tests": [3]})", "is no object"},
      {"abs", R"({"tests": [{}]})", "has no expected"},
      {"abs", file_of("{}", "", y), "has no input 1"},
      {"abs", file_of("3", "", y), "has no input 1"},
      {"abs", file_of(x, "", tensor("[2]", "[1, 2]", "float16")), "not of type float32"},
      {"abs", file_of(x, "", tensor("[3]", "[1, 2]")), "do not fit its shape"},
      {"abs", file_of(x, "", tensor("[0]", "[]")), "without elements"},
      {"abs", file_of(x, "", tensor("[1.5]", "[1]")), "no list of whole numbers"},
      {"abs", file_of(x, "", tensor("[1e99]", "[1]")), "no list of whole numbers"},
      {"abs", file_of(x, "", tensor("[16777216, 16777216, 16777216, 16777216]", "[1]")),
       "do not fit its shape"},
      {"abs", file_of(x, "", tensor("[1, 1, 1, 1, 1, 1]", "[1]")), "too many axes"},
      {"abs", file_of(x, "", tensor("[2]", R"([1, "NaN"])")), "is no number"},
      {"abs", file_of(x, "", tensor("[2]", "[1, 1e400]")), ""},
      {"sign", file_of(x, "", y), "is no test of an operator that SLIDE has"},
      {"conv2d", file_of(x, "", y), "is no operator on images"},
      {"conv2d", file_of(image, R"(, "options": {"inputLayout": "chwn"})", kOneToNine), "unknown layout"},
      {"conv2d", file_of(image, R"(, "options": {"filterLayout": 3})", kOneToNine), "that is no text"},
      {"conv2d", file_of(image, R"(, "options": {"strides": [0, 1]})", kOneToNine), "stride"},
      {"conv2d", file_of(image, R"(, "options": {"strides": [1]})", kOneToNine), "has 1 numbers as strides"},
      {"conv2d", file_of(image, R"(, "options": {"autoPad": "same-upper", "strides": [0, 0]})", kOneToNine),
       "that is none"},
      {"conv2d", file_of(image, R"(, "options": {"padding": [-1, 0, 0, 0]})", kOneToNine), "padding"},
      {"average_pool2d", file_of(image, R"(, "options": {"dilations": [2, 2]})", kOneToNine), "is dilated"},
      {"reduce_max", file_of(x, "", tensor("[]", "2")), "drops the axes"},
      {"pad", file_of(x, "", y), "pads more than"},
      {"clamp", file_of(x, R"(, "options": {"minValue": "1"})", y), "that is no number"},
  };
  for (const Bad& b : bad) {
    const std::string json = b.json.substr(0, 400);
    CAPTURE(json);
    const std::string message = problem(b.json, b.op);
    CHECK_FALSE(message.empty());
    CHECK(message.find(b.says) != std::string::npos);
  }
}

TEST_CASE("a WebNN file's tests are named by their number, in folders, too") {
  const TemporaryFolder folder;
  const auto write = [&](const std::string& name, const std::string& text) {
    write_bytes(folder.file(name), std::as_bytes(std::span(text)));
  };
  const std::string x = tensor("[2]", "[-1, 2]");
  const std::string right = R"({"inputs": {"x": )" + x + R"(}, "expected": )" + tensor("[2]", "[1, 2]") + "}";
  const std::string wrong = R"({"inputs": {"x": )" + x + R"(}, "expected": )" + x + "}";
  write("abs.json", "{\"tests\": [ // the first\n" + right + ", " + wrong + "]}");
  write("relu.json", R"({"tests": [)" + wrong + "]}");
  write("package.json", R"({"name": "no tests"})");
  const std::string abs = folder.file("abs.json");
  const std::vector<std::string> both = {abs + "#1", abs + "#2"};
  CHECK(ops::case_files(abs) == both);
  CHECK(ops::case_files(abs + "#2") == std::vector{abs + "#2"});
  CHECK(ops::case_files(folder.path().string()) ==
        std::vector<std::string>{abs + "#1", abs + "#2", folder.file("relu.json") + "#1"});
  CHECK(ops::read_case(folder.file("relu.json")).op == "relu");
  CHECK_THROWS_WITH_AS((void)ops::read_case(abs), doctest::Contains("the file holds 2 tests"), Error);
  CHECK_THROWS_WITH_AS((void)ops::read_case(abs + "#3"), doctest::Contains("there is no test 3"), Error);
  CHECK_THROWS_WITH_AS((void)ops::read_case(folder.file("package.json")), doctest::Contains("\"tests\""),
                       Error);
  CHECK_THROWS_AS((void)ops::read_case(folder.file("missing.json#1")), Error);

  const std::vector<ops::CheckedFile> files = ops::check_files({abs}, Isa::kBaseline);
  REQUIRE(files.size() == 2);
  CHECK(files[0].check->passed());
  CHECK_FALSE(files[1].check->passed());
}
