#include "ops/case_io.h"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <optional>

#include "ops/onnx/onnx_case.h"
#include "ops/webnn/webnn_case.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"
#include "runtime/safetensors_writer.h"

namespace slide::ops {
namespace {

constexpr const char* kExpected = "expected";
constexpr const char* kActual = "actual";
constexpr const char* kOnnxModel = "model.onnx";
constexpr const char* kScale = "scale";

std::string metadata_or(const SafetensorsFile& file, std::string_view key, const std::string& otherwise) {
  const auto it = file.metadata().find(key);
  return it == file.metadata().end() ? otherwise : it->second;
}

/// The safetensors reader takes every file for a weight file; a case is an input.
SafetensorsFile open_input(const std::string& path) {
  try {
    return SafetensorsFile::open(path);
  } catch (const Error& e) {
    if (e.kind() != ErrorKind::kBadWeights) throw;
    throw Error(ErrorKind::kBadInput, e.what());
  }
}

/// A test of a WebNN file: "conv2d.json#3", or the only one of "conv2d.json".
struct WebnnTest {
  std::string file;
  std::optional<std::size_t> index;
};
constexpr std::string_view kJson = ".json";

std::optional<WebnnTest> webnn_test(const std::string& path) {
  if (path.ends_with(kJson)) return WebnnTest{path, std::nullopt};
  const std::size_t mark = path.rfind('#');
  if (mark == std::string::npos || !path.substr(0, mark).ends_with(kJson)) return std::nullopt;
  std::size_t index = 0;
  const char* end = path.data() + path.size();
  const auto [rest, error] = std::from_chars(path.data() + mark + 1, end, index);
  if (error != std::errc() || rest != end) return std::nullopt;
  return WebnnTest{path.substr(0, mark), index};
}

OperatorCase read_webnn(const WebnnTest& test) {
  if (test.index) return read_webnn_case(test.file, *test.index);
  if (const std::size_t count = webnn_tests(test.file).value_or(1); count != 1)
    throw Error(ErrorKind::kBadInput, test.file + ": the file holds " + std::to_string(count) + " tests",
                "name one: " + test.file + "#1");
  return read_webnn_case(test.file, 1);
}

/// Every test of a file by name; the file itself if it holds none.
std::vector<std::string> webnn_names(const std::string& file) {
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= webnn_tests(file).value_or(0); ++i)
    names.push_back(file + "#" + std::to_string(i));
  return names;
}

}  // namespace

OperatorCase read_case(const std::string& path) {
  const std::filesystem::path file_or_folder(path);
  std::error_code ignored;
  if (std::filesystem::is_directory(file_or_folder, ignored))
    return read_onnx_case((file_or_folder / kOnnxModel).string());
  if (file_or_folder.extension() == ".onnx") return read_onnx_case(path);
  if (const std::optional<WebnnTest> test = webnn_test(path)) return read_webnn(*test);
  const SafetensorsFile file = open_input(path);
  OperatorCase result;
  result.op = metadata_or(file, "op", "");
  if (result.op.empty())
    throw Error(ErrorKind::kBadInput, path + ": not an operator case: there is no metadata \"op\"");
  result.attributes = metadata_or(file, "attributes", "{}");
  result.source = metadata_or(file, "source", "");
  for (const TensorInfo& info : file.tensors()) {
    if (info.name == kExpected)
      result.expected = file.tensor(info.name);
    else if (info.name != kActual && info.name != kScale)
      result.inputs.emplace_back(info.name, file.tensor(info.name));
  }
  if (!file.contains(kExpected))
    throw Error(ErrorKind::kBadInput, path + ": not an operator case: there is no tensor \"expected\"");
  const DType type = file.info(kExpected).dtype;
  if (type != DType::kF64 && type != DType::kF32)
    throw Error(ErrorKind::kBadInput, path + ": the tensor \"expected\" is " + std::string(name_of(type)) +
                                          ", F64 or F32 is needed");
  return result;
}

std::optional<Tensor> tensor_in(const std::string& path, std::string_view name) {
  const SafetensorsFile file = open_input(path);
  if (file.contains(name)) return file.tensor(name);
  if (file.tensors().size() == 1) return file.tensor(file.tensors()[0].name);
  return std::nullopt;
}

void write_case(const std::string& path, const OperatorCase& operator_case) {
  std::vector<std::pair<std::string, Tensor>> tensors = operator_case.inputs;
  tensors.emplace_back(kExpected, operator_case.expected);
  if (!operator_case.scale.empty()) tensors.emplace_back(kScale, operator_case.scale);
  Metadata metadata{{"op", operator_case.op}, {"attributes", operator_case.attributes}};
  if (!operator_case.source.empty()) metadata["source"] = operator_case.source;
  write_safetensors(path, tensors, metadata);
}

std::vector<std::string> case_files(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  std::vector<std::string> files;
  if (!fs::exists(status)) {
    if (const std::optional<WebnnTest> test = webnn_test(path); test && test->index) return {path};
    throw Error(ErrorKind::kBadInput, path + ": there is no such file or folder");
  }
  if (!fs::is_directory(status)) {
    if (path.ends_with(kJson)) files = webnn_names(path);
    return files.empty() ? std::vector{path} : files;
  }
  for (fs::recursive_directory_iterator it(path, error), end; !error && it != end; it.increment(error))
    if ((it->path().extension() == ".safetensors" || it->path().filename() == kOnnxModel) &&
        !it->is_directory(error))
      files.push_back(it->path().string());
    else if (it->path().extension() == kJson && !it->is_directory(error))
      std::ranges::copy(webnn_names(it->path().string()), std::back_inserter(files));
  if (error) throw Error(ErrorKind::kBadInput, path + ": cannot read the folder: " + error.message());
  if (files.empty())
    throw Error(ErrorKind::kBadInput,
                path + ": the folder holds no .safetensors file, no model.onnx and no WebNN test");
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace slide::ops
