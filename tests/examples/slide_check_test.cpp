#include <doctest/doctest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "ops/case_io.h"
#include "runtime/cpu.h"
#include "runtime/safetensors_writer.h"
#include "tests/examples/program.h"
#include "tests/ops/onnx_node.h"

using namespace slide;
using slide::test::ProgramResult;

namespace {

const std::string kData = SLIDE_TEST_DATA;
const std::string kGolden = kData + "/networks/inpaint_coarse.safetensors";

ProgramResult slide_check(const std::vector<std::string>& arguments) {
  return slide::test::run_program(SLIDE_CHECK, arguments);
}

void write_relu_case(const std::string& path, double expected) {
  ops::OperatorCase c;
  c.op = "relu";
  const double x[] = {-1, 2};
  const double y[] = {0, expected};
  c.inputs = {{"x", Tensor::from<double>({2}, std::span<const double>(x))}};
  c.expected = Tensor::from<double>({2}, std::span<const double>(y));
  ops::write_case(path, c);
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("slide_check op passes a folder of cases and says so") {
  const ProgramResult result = slide_check({"op", kData + "/onnx_cases"});
  CHECK(result.code == 0);
  CHECK(result.errors.empty());
  CHECK(contains(result.output, "float64 definition"));
  CHECK(contains(result.output, "all within their bounds"));
}

TEST_CASE("slide_check generate writes cases that op passes, and refuses what it cannot make") {
  const TemporaryFolder folder;
  const std::string cases = folder.file("cases");
  const ProgramResult result =
      slide_check({"generate", "layer_norm", "--seed", "4", "--count", "8", "-o", cases});
  CHECK(result.code == 0);
  CHECK(result.output == "8 operator cases written to " + cases + "\n");
  const ProgramResult check = slide_check({"op", cases});
  CHECK_MESSAGE(check.code == 0, check.output);
  CHECK(contains(check.output, "8 cases, "));
  CHECK(slide_check({"generate", "layer_norm", "--count", "0", "-o", cases}).code == 2);
  CHECK(slide_check({"generate", "layer_nrm", "-o", cases}).code == 2);
  CHECK(slide_check({"generate", "relu", "-o", cases + "/layer_norm_4_0000_random.safetensors"}).code == 7);
}

TEST_CASE("slide_check judges a result of one of ONNX's node tests") {
  using namespace slide::test;
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder.file("test_data_set_0"));
  const auto write = [&](const std::string& name, const std::string& content) {
    std::ofstream(folder.file(name), std::ios::binary) << content;
  };
  write("model.onnx", onnx_model("Relu", {"x"}));
  write("test_data_set_0/input_0.pb", onnx_tensor({3}, {-1, 2, 3}));
  write("test_data_set_0/output_0.pb", onnx_tensor({3}, {0, 2, 3}));
  const std::string actual = folder.file("y.safetensors");
  write_safetensors(actual, {{"y", Tensor::from<float>({3}, std::vector<float>{0, 2, 3})}});
  const std::string model = folder.file("model.onnx");
  CHECK(slide_check({"op", model}).code == 0);
  CHECK(slide_check({"judge", model, "--actual", actual}).code == 0);
  CHECK(slide_check({"judge", folder.path().string(), "--actual", actual}).code == 0);
  write_safetensors(actual, {{"y", Tensor::from<float>({3}, std::vector<float>{-1, 2, 3})}});
  CHECK(slide_check({"judge", model, "--actual", actual}).code == 1);
  const ProgramResult none = slide_check({"judge", model});
  CHECK(none.code == 2);
  CHECK(contains(none.errors, "--actual"));
}

TEST_CASE("slide_check op ends with 1 if a case fails, and still checks the others") {
  const TemporaryFolder folder;
  write_relu_case(folder.file("wrong.safetensors"), 3);
  write_relu_case(folder.file("good.safetensors"), 2);
  const ProgramResult result =
      slide_check({"op", "--json", folder.file("wrong.safetensors"), folder.file("missing.safetensors"),
                   folder.file("good.safetensors")});
  CHECK(result.code == 1);
  const nlohmann::json json = nlohmann::json::parse(result.output);
  CHECK(json["passed"] == false);
  REQUIRE(json["cases"].size() == 3);
  CHECK(json["cases"][0]["passed"] == false);
  CHECK(json["cases"][1].contains("error"));
  CHECK(json["cases"][2]["passed"] == true);
  CHECK(contains(result.errors, "missing.safetensors"));
  const ProgramResult table = slide_check({"op", folder.file("missing.safetensors")});
  CHECK(table.code == 3);
  CHECK(contains(table.errors, "missing.safetensors"));
  CHECK(!contains(table.output, "missing.safetensors"));
}

TEST_CASE("a report that cannot be written is a failure of its own") {
  for (const std::vector<std::string>& call :
       {std::vector<std::string>{"op", kData + "/onnx_cases"}, {"--help"}}) {
    const ProgramResult result = slide::test::run_program(SLIDE_CHECK, call, "/dev/full");
    CHECK(result.code == 7);
    CHECK(contains(result.errors, "cannot write to standard output"));
  }
}

TEST_CASE("slide_check judge takes a result from its own file or the case, and says where it is wrong") {
  const TemporaryFolder folder;
  const std::string path = folder.file("c.safetensors");
  write_relu_case(path, 2);
  CHECK(slide_check({"judge", path}).code == 3);
  const float right[] = {0, 2};
  const float wrong[] = {-1, 2};
  write_safetensors(folder.file("right"), {{"y", Tensor::from<float>({2}, std::span<const float>(right))}});
  write_safetensors(folder.file("wrong"), {{"y", Tensor::from<float>({2}, std::span<const float>(wrong))}});
  CHECK(slide_check({"judge", path, "--actual", folder.file("right")}).code == 0);
  const ProgramResult result = slide_check({"judge", path, "--actual", folder.file("wrong")});
  CHECK(result.code == 1);
  CHECK(contains(result.output, "1 of 2 elements over their bound"));
  CHECK(contains(result.output, "[0] is -1, should be 0"));
  CHECK(slide_check({"judge", path, "--actual", folder.file("right"), "--unit", "fp8"}).code == 2);
  CHECK(slide_check({"judge", path, "--actual", folder.file("none.npy")}).code == 3);
}

#if defined(SLIDE_OPERATOR_LIBRARIES)
TEST_CASE("slide_check judge calls the operator of a shared library") {
  const TemporaryFolder folder;
  const std::string path = folder.file("c.safetensors");
  write_relu_case(path, 2);
  const auto judge = [&](const std::string& library) {
    return slide_check({"judge", path, "--library", library});
  };
  const std::string built = SLIDE_OPERATOR_LIBRARIES;
  const ProgramResult right = judge(built + "NONE.so");
  CHECK_MESSAGE(right.code == 0, right.errors);
  CHECK(contains(right.output, "relu in fp32: right"));
  const ProgramResult wrong = judge(built + "LEAVES_LAST.so");
  CHECK(wrong.code == 1);
  CHECK(contains(wrong.output, "[1] is -1, should be 2"));
  const ProgramResult outside = judge(built + "WRITES_BEHIND.so");
  CHECK(outside.code == 3);
  CHECK(contains(outside.errors, "wrote outside of its result"));
  const ProgramResult other =
      slide_check({"judge", kData + "/hard_cases/exp_ends.safetensors", "--library", built + "NONE.so"});
  CHECK(other.code == 3);
  CHECK(contains(other.errors, "slide_operator() returned 7 for exp"));
  CHECK(judge(folder.file("none.so")).code == 3);
  CHECK(contains(judge("libm.so.6").errors, "cannot be loaded"));  // not searched for
  CHECK(slide_check({"judge", path, "--library", built + "NONE.so", "--actual", path}).code == 2);

  const std::string exp = kData + "/hard_cases/exp_ends.safetensors";
  const ProgramResult many = slide_check({"judge", path, exp, path, "--library", built + "LEAVES_LAST.so"});
  CHECK(many.code == 1);
  CHECK(contains(many.output, path + "\nrelu in fp32: WRONG"));
  CHECK(contains(many.output, "3 cases: 0 right, 2 wrong, 1 without a result\n"));
  const ProgramResult both = slide_check({"judge", path, path, "--library", built + "NONE.so"});
  CHECK(both.code == 0);
  CHECK(both.output == "2 cases: 2 right, 0 wrong\n");
  CHECK(slide_check({"judge", exp, exp, "--library", built + "NONE.so"}).code == 3);
  CHECK(slide_check({"judge", path, path, "--actual", path}).code == 2);
}

TEST_CASE("slide_check's tutorial prints what its page shows") {
  const TemporaryFolder folder;
  const std::string cases = folder.file("cases");
  REQUIRE(slide_check({"generate", "conv2d", "--count", "64", "-o", cases}).code == 0);
  const std::string library = SLIDE_TUTORIAL_LIBRARY;
  const ProgramResult all = slide_check({"judge", cases, "--library", library});
  CHECK(all.code == 1);
  const std::vector<std::byte> page = bytes_of_file(kData + "/../../docs/slide_check.md");
  const std::string text(reinterpret_cast<const char*>(page.data()), page.size());
  CHECK(contains(text, "\n" + all.output.substr(all.output.rfind('\n', all.output.size() - 2) + 1)));
  const ProgramResult one =
      slide_check({"judge", cases + "/conv2d_1_0061_specials.safetensors", "--library", library});
  CHECK(one.code == 1);
  CHECK(contains(text, "\n" + one.output));
}
#endif

TEST_CASE("slide_check judge prints what its page shows") {
  const TemporaryFolder folder;
  const std::string path = kData + "/onnx_cases/test_basic_conv_with_padding.safetensors";
  const ops::OperatorCase c = ops::read_case(path);
  Tensor y = c.expected.clone();
  for (std::size_t row = 0; row < 5; ++row) y.mutable_data<float>()[row * 5 + 4] = 0;
  write_safetensors(folder.file("y.safetensors"), {{"y", y}});
  const ProgramResult result = slide_check({"judge", path, "--actual", folder.file("y.safetensors")});
  CHECK(result.code == 1);
  const std::vector<std::byte> page = bytes_of_file(kData + "/../../docs/slide_check.md");
  const std::string text(reinterpret_cast<const char*>(page.data()), page.size());
  std::istringstream lines(result.output);
  std::string line;
  int count = 0;
  for (; std::getline(lines, line); ++count) CHECK_MESSAGE(contains(text, "\n" + line + "\n"), line);
  CHECK(count == 6);
}

TEST_CASE("slide_check tells usage, bad input and bad weights apart") {
  const TemporaryFolder folder;
  const std::string junk = folder.file("junk.safetensors");
  write_bytes(junk, {});
  CHECK(slide_check({}).code == 2);
  CHECK(slide_check({"op"}).code == 2);
  CHECK(slide_check({"op", "--isa", "mmx", junk}).code == 2);
  CHECK(slide_check({"op", junk}).code == 3);
  CHECK(slide_check({"net", "no_such_model", "--formula-weights", "--golden", kGolden}).code == 2);
  CHECK(slide_check({"net", "fba", "--formula-weights", "--golden", kGolden}).code == 2);
  CHECK(slide_check({"net", "inpaint_coarse", "--golden", kGolden}).code == 2);
  CHECK(slide_check({"net", "inpaint_coarse", "--formula-weights", "--golden", junk}).code == 3);
  CHECK(slide_check({"net", "inpaint_coarse", "--weights", junk, "--golden", kGolden}).code == 4);
  CHECK(slide_check({"compare", "u2netp", "--formula-weights", "--image", junk}).code == 3);
  CHECK(slide_check({"compare", "u2netp", "--weights", junk, "--image", kData + "/images/none.png"}).code ==
        4);
  const ProgramResult result = slide_check({"op", junk});
  CHECK(contains(result.errors, junk));
  CHECK(slide_check({"--help"}).code == 0);
}

TEST_CASE("slide_check net compares a golden run") {
  const ProgramResult result =
      slide_check({"net", "inpaint_coarse", "--formula-weights", "--golden", kGolden, "--fused", "--json"});
  CHECK(result.code == 0);
  const nlohmann::json json = nlohmann::json::parse(result.output);
  CHECK(json["passed"] == true);
  CHECK(json["model"] == "inpaint_coarse");
  for (const auto& tensor : json["tensors"]) CHECK(tensor["float64_vs_golden"] <= tensor["tolerance"]);
  for (const auto& node : json["nodes"]) CHECK(node["of_bound"] <= 1);
  REQUIRE(json["fused"].size() == 1);
  CHECK(json["fused"][0]["output"] == "0");
  CHECK(json["fused"][0]["max_error"] > 0);
  CHECK(json["fused"][0]["max_error"] < 1e-4);  // as in golden_test.cpp
}

TEST_CASE("slide_check shows the error that a lower precision makes beside the predicted one") {
  const ProgramResult result = slide_check(
      {"net", "inpaint_coarse", "--formula-weights", "--golden", kGolden, "--precision", "bf16", "--json"});
  CHECK(result.code == 0);
  const nlohmann::json output = nlohmann::json::parse(result.output)["fused"].at(0);
  // Random weights and noise for a photo amplify errors: docs/precision.md.
  CHECK(output["rms_error"] > 0.1 * output["predicted_rms_error"].get<double>());
  CHECK(output["rms_error"] < 10 * output["predicted_rms_error"].get<double>());
  if (runs_at(Isa::kAmx, active_isa()))
    CHECK(output["predicted_rms_error"] > 1e-3);  // elsewhere float32 may do
  CHECK(output["predicted_rms_error"] < 5e-2);    // nine layers by Winograd's F(4), which make 1.2 % each
  CHECK(slide_check({"net", "inpaint_coarse", "--formula-weights", "--golden", kGolden, "--precision", "fp8"})
            .code == 2);
}

TEST_CASE(
    "slide_check compare sorts by error, and what it dumps passes slide_check op at a lower level too") {
  const TemporaryFolder folder;
  const std::string dump = folder.file("dump");
  const ProgramResult result =
      slide_check({"compare", "u2netp", "--formula-weights", "--image", kData + "/images/rgb_8.png", "--size",
                   "32", "--dump", dump, "--threads", "1"});
  CHECK(result.code == 0);
  CHECK(contains(result.output, "every kernel within its bound"));
  std::istringstream lines(result.output);
  std::string line;
  std::getline(lines, line);
  const std::size_t column = line.find("max error");
  REQUIRE(column != std::string::npos);
  double last = 1e300;
  int rows = 0;
  while (std::getline(lines, line) && !contains(line, " nodes at level ")) {
    const double error = std::stod(line.substr(column));
    CHECK(error <= last);
    last = error;
    ++rows;
  }
  CHECK(rows > 100);
  CHECK(rows ==
        std::distance(std::filesystem::directory_iterator(dump), std::filesystem::directory_iterator()));
  CHECK(slide_check({"op", "--isa", "baseline", "--threads", "1", dump}).code == 0);
}
