#include "weights_tools/convert.h"
#include "weights_tools/prefix.h"

#include <doctest/doctest.h>

#include <filesystem>
#include <limits>
#include <new>
#include <string>
#include <vector>

#include "graphs/catalogue.h"
#include "runtime/error.h"
#include "runtime/safetensors_writer.h"
#include "tests/temporary_folder.h"
#include "tests/weights_tools/builders.h"
#include "tests/weights_tools/list.h"

using namespace slide;
using slide::test::List;
using slide::test::parameters_of;

namespace {

const std::string kFolder = SLIDE_TEST_DATA "/checkpoints/";

std::string message_of(const auto& action) {
  try {
    action();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

}  // namespace

TEST_CASE("each model is recognised by the names and shapes of its tensors") {
  for (const graphs::Model& model : graphs::catalogue()) {
    List list;
    list.list = parameters_of(model.name);
    list.said["model"] = model.name;  // some models differ in what they are trained for, not in their tensors
    const Detection found = detect_model(list);
    CHECK(found.model == model.name);
    list.said.clear();
    const Detection unsaid = detect_model(list);
    CHECK((unsaid.model == model.name || unsaid.detail.find(std::string(model.name)) != std::string::npos));
  }
}

TEST_CASE("a prefix that all names share is needless if the tensors fit without it") {
  List list;
  list.list = parameters_of("u2netp");
  CHECK(needless_prefix(list, "").empty());
  for (TensorInfo& info : list.list) info.name = "module.net." + info.name;
  CHECK(needless_prefix(list, "") == "module.net.");
  CHECK(needless_prefix(list, "u2netp") == "module.net.");
  CHECK(needless_prefix(list, "fba").empty());
  const std::string first = list.list.front().name;
  const auto shorter = without_prefix(std::make_unique<List>(list.list), "module.");
  CHECK("module." + shorter->tensors().front().name == first);
  CHECK(detect_model(*without_prefix(std::make_unique<List>(list.list), "module.net.")).model == "u2netp");
  list.list.front().name = "other." + first;
  CHECK(needless_prefix(list, "").empty());
}

TEST_CASE("tensors that only the authors' files hold are expected, and models that fit alike are told") {
  List midas;
  midas.list = parameters_of("midas_v21_small");
  midas.list.push_back({"scratch.refinenet4.resConfUnit1.conv1.weight", DType::kF32, {1}});
  CHECK(detect_model(midas).model == "midas_v21_small");
  CHECK(detect_model(midas).detail.empty());
  List own;
  own.list = parameters_of("slide_matte");
  CHECK(detect_model(own).model == "slide_depth");
  CHECK(detect_model(own).detail == "w.pt: the tensors fit slide_matte just as well");
}

TEST_CASE("tensors that fit no model are compared with the closest, in one message") {
  List list;
  list.list = parameters_of("u2netp");
  const std::string gone = list.list[3].name;
  list.list.erase(list.list.begin() + 3);
  list.list[0].shape = Shape{1, 2};
  list.list.push_back({"extra.weight", DType::kF32, {1}});
  list.list.push_back({"extra.num_batches_tracked", DType::kI64, {}});
  const Detection found = detect_model(list);
  CHECK(found.model.empty());
  CHECK(found.detail.find("w.pt fits no model, u2netp comes closest: missing (1): " + gone) !=
        std::string::npos);
  CHECK(found.detail.find(list.list[0].name + ": has 1x2, the network needs") != std::string::npos);
  CHECK(found.detail.find("not used by the network (1): extra.weight") != std::string::npos);

  List with_more;
  with_more.list = parameters_of("u2netp");
  with_more.list.push_back({"extra.weight", DType::kF32, {1}});
  CHECK(detect_model(with_more).model == "u2netp");
  CHECK(detect_model(with_more).detail == "w.pt: not used by the network (1): extra.weight");

  List other;
  other.list = {{"extra.weight", DType::kF32, {1}}};
  CHECK(detect_model(other).detail == "w.pt: its tensors belong to none of the models");
}

TEST_CASE("a checkpoint becomes a safetensors file with the same values and the metadata") {
  const TemporaryFolder folder;
  const std::unique_ptr<WeightReader> reader = open_weights(kFolder + "stream.pt");
  const std::unique_ptr<WeightReader> expected = open_weights(kFolder + "expected.safetensors");
  for (const DType type : {DType::kF32, DType::kF16, DType::kBF16}) {
    const ConvertReport report = convert(*reader, folder.file("w"), {.model = "any", .dtype = type});
    CHECK(report.tensors == 26);
    CHECK(report.warnings.empty());
    const SafetensorsFile file = SafetensorsFile::open(folder.file("w"));
    CHECK(file.verify_crc() == 26);
    CHECK(file.metadata().at("source_file") == "stream.pt");
    CHECK(file.metadata().at("source_sha256") ==
          "4a2a89ce77b432dcc1b4b026bf4a88c364b8b836ef2214e506c501075dd19597");
    CHECK(!file.metadata().contains("model"));
    std::uint64_t bytes = 0;
    for (std::size_t i = 0; i < expected->tensors().size(); ++i) {
      const TensorInfo& info = expected->tensors()[i];
      const bool number = info.dtype == DType::kF64 || info.dtype == DType::kF32 ||
                          info.dtype == DType::kF16 || info.dtype == DType::kBF16;
      const Tensor wanted = number ? load(*expected, i).to(type) : load(*expected, i);
      const Tensor found = file.tensor(info.name);
      CHECK(found.dtype() == wanted.dtype());
      REQUIRE(found.shape() == wanted.shape());
      CHECK(std::equal(found.raw().begin(), found.raw().end(), wanted.raw().begin()));
      bytes += found.bytes();
    }
    CHECK(report.bytes == bytes);
  }
  CHECK(folder.entries() == 1);
}

TEST_CASE("a model's name is written, and what does not fit it is refused without a file left behind") {
  const TemporaryFolder folder;
  std::vector<std::pair<std::string, Tensor>> tensors;
  for (const TensorInfo& info : parameters_of("u2netp"))
    tensors.emplace_back(info.name, Tensor::zeros(DType::kF32, info.shape));
  write_safetensors(folder.file("source"), tensors, {{"licence", "CC0"}});
  const std::unique_ptr<WeightReader> reader = open_weights(folder.file("source"));
  CHECK(convert(*reader, folder.file("w"), {.model = "", .dtype = DType::kBF16}).model == "u2netp");
  const SafetensorsFile file = SafetensorsFile::open(folder.file("w"));
  CHECK(file.metadata().at("model") == "u2netp");
  CHECK(file.metadata().at("licence") == "CC0");
  CHECK(file.metadata().at("source_file") == "source");
  CHECK(message_of([&] {
          convert(*reader, folder.file("x"), {.model = "midas_v21"});
        }).find("source as midas_v21: missing (") != std::string::npos);
  CHECK(message_of([&] {
          convert(*reader, folder.file("x"), {.model = "midas"});
        }).find("no model named midas") != std::string::npos);
  CHECK(folder.entries() == 2);

  const std::unique_ptr<WeightReader> again = open_weights(folder.file("w"));
  convert(*again, folder.file("w2"), {.model = "u2netp"});
  CHECK(SafetensorsFile::open(folder.file("w2")).metadata().at("source_file") == "source");
}

TEST_CASE("a calibration is kept, or dropped before another one, be it broken") {
  const TemporaryFolder folder;
  write_safetensors(folder.file("source"), {{"w", Tensor::zeros(DType::kF32, {1})}},
                    {{"calibration", "broken"}, {"licence", "CC0"}});
  const std::unique_ptr<WeightReader> reader = open_weights(folder.file("source"));
  convert(*reader, folder.file("kept"), {.model = "any"});
  CHECK(SafetensorsFile::open(folder.file("kept")).metadata().at("calibration") == "broken");
  const auto calibrate = [&](const std::string& model, const WeightSource& weights) {
    CHECK(model == "any");
    CHECK(weights.calibration() == nullptr);
    CHECK(weights.names() == std::vector<std::string>{"w"});
    CHECK(!std::filesystem::exists(folder.file("calibrated")));
    Calibration calibration;
    calibration.layers["layer"] = {{-1, 2}, 0.5};
    return calibration;
  };
  CHECK(convert(*reader, folder.file("calibrated"), {.model = "any", .calibrate = calibrate}).calibrated ==
        1);
  const SafetensorsWeights calibrated(folder.file("calibrated"));
  REQUIRE(calibrated.calibration() != nullptr);
  CHECK(calibrated.calibration()->layers.at("layer").range.high == 2);
  CHECK(calibrated.file().metadata().at("licence") == "CC0");
  CHECK(calibrated.file().verify_crc() == 1);
  CHECK(folder.entries() == 3);
}

TEST_CASE("a calibration that fails leaves the older file as it was and nothing else") {
  const TemporaryFolder folder;
  write_safetensors(folder.file("source"), {{"w", Tensor::zeros(DType::kF32, {1})}});
  write_text(folder.file("w"), "older");
  const auto fails = [](const std::string&, const WeightSource&) -> Calibration { throw std::bad_alloc(); };
  CHECK_THROWS_AS(convert(*open_weights(folder.file("source")), folder.file("w"),
                          {.model = "any", .calibrate = fails, .overwrite = true}),
                  std::bad_alloc);
  CHECK(bytes_of_file(folder.file("w")).size() == 5);
  CHECK(folder.entries() == 2);
}

TEST_CASE("a file that convert() has not made, or that was changed since, is replaced only if told so") {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& output) {
    const std::string path = folder.file(output);
    const std::vector<std::byte> before = bytes_of_file(path);
    const auto reader = open_weights(kFolder + "tiny_zip.pt");
    const std::string message = message_of([&] { convert(*reader, path, {.model = "any"}); });
    const bool lost = message == path + " exists, and SLIDE has not made it: it would be lost (give the " +
                                     "output another name, or add --overwrite)";
    CHECK((lost || message == "no error"));
    CHECK((!lost || bytes_of_file(path) == before));
    return lost;
  };
  CHECK_FALSE(refused("new"));
  CHECK_FALSE(refused("new"));  // what it made itself
  std::ofstream(folder.file("empty")).flush();
  CHECK_FALSE(refused("empty"));

  write_text(folder.file("text"), "a letter");
  CHECK(refused("text"));
  const Tensor w = Tensor::zeros(DType::kF32, {4});
  write_safetensors(folder.file("case"), {{"w", w}}, {{"op", "relu"}});  // SLIDE's, but no converted weights
  CHECK(refused("case"));
  // Somebody trained on, and kept the metadata: the checksums no longer fit.
  write_safetensors(folder.file("trained"), {{"w", w}}, {{"source_sha256", "0"}});
  CHECK_FALSE(refused("trained"));
  write_safetensors(folder.file("trained"), {{"w", w}}, {{"source_sha256", "0"}});
  flip_bit(folder.file("trained"), 8 * bytes_of_file(folder.file("trained")).size() - 1);
  CHECK(refused("trained"));
  const auto reader = open_weights(kFolder + "tiny_zip.pt");
  convert(*reader, folder.file("trained"), {.model = "any", .overwrite = true});
  CHECK_FALSE(refused("trained"));
}

TEST_CASE("a flipped bit is not given a new checksum") {
  const TemporaryFolder folder;
  write_safetensors(folder.file("w"),
                    {{"a", Tensor::zeros(DType::kF32, {2})}, {"b", Tensor::zeros(DType::kF32, {4})}});
  flip_bit(folder.file("w"), 8 * bytes_of_file(folder.file("w")).size() - 1);
  CHECK(message_of([&] {
          convert(*open_weights(folder.file("w")), folder.file("x"), {.model = "any"});
        }).find("tensor b: its data does not match its checksum") != std::string::npos);
  CHECK(folder.entries() == 1);
}

TEST_CASE("the file that is read is never the one written, however it is called") {
  const TemporaryFolder folder;
  const std::vector<std::byte> bytes = bytes_of_file(kFolder + "tiny_zip.pt");
  write_bytes(folder.file("n.pt"), bytes);
  std::filesystem::create_symlink(folder.file("n.pt"), folder.file("symbolic"));
  std::filesystem::create_hard_link(folder.file("n.pt"), folder.file("hard"));
  const auto reader = open_weights(folder.file("n.pt"));
  for (const std::string name : {"n.pt", "symbolic", "hard", "./n.pt"})
    CHECK(message_of([&] {
            convert(*reader, folder.file(name), {.model = "any"});
          }).find("this is the file that is read") != std::string::npos);
  CHECK(bytes_of_file(folder.file("n.pt")) == bytes);
  CHECK(folder.entries() == 3);
}

TEST_CASE("a network with a value that is not finite is not converted") {
  const TemporaryFolder folder;
  std::vector<std::pair<std::string, Tensor>> tensors;
  for (const TensorInfo& info : parameters_of("u2netp"))
    tensors.emplace_back(info.name, Tensor::zeros(DType::kF32, info.shape));
  tensors[4].second.mutable_data<float>()[3] = std::numeric_limits<float>::infinity();
  write_safetensors(folder.file("source"), tensors);
  CHECK(message_of([&] {
          convert(*open_weights(folder.file("source")), folder.file("w"), {.model = "u2netp"});
        }).find("tensor " + tensors[4].first + ": element 3 is not a finite number") != std::string::npos);
  CHECK(folder.entries() == 1);
}

TEST_CASE("a value that the dtype cannot hold is an error, one that was never finite a warning") {
  const TemporaryFolder folder;
  write_safetensors(folder.file("large"),
                    {{"a", Tensor::from<float>({2}, std::vector<float>{1.0F, 70000.0F})}});
  write_safetensors(
      folder.file("nan"),
      {{"a", Tensor::from<float>({1}, std::vector<float>{std::numeric_limits<float>::quiet_NaN()})}});
  const auto large = open_weights(folder.file("large"));
  CHECK(message_of([&] {
          convert(*large, folder.file("x"), {.model = "any", .dtype = DType::kF16});
        }).find("tensor a holds a value too large for F16 (choose another --dtype)") != std::string::npos);
  CHECK(folder.entries() == 2);
  CHECK(convert(*large, folder.file("x"), {.model = "any", .dtype = DType::kBF16}).warnings.empty());
  const auto nan = open_weights(folder.file("nan"));
  const ConvertReport report = convert(*nan, folder.file("x"), {.model = "any", .dtype = DType::kF16});
  REQUIRE(report.warnings.size() == 1);
  CHECK(report.warnings[0].find("tensor a holds values that are not finite") != std::string::npos);
  CHECK(message_of([&] {
          static_cast<void>(verify(*nan));
        }).find("tensor a: element 0 is not a finite number") != std::string::npos);
}

TEST_CASE("the hash that a file's name promises is compared with the file's") {
  CHECK(hash_in_name("/x/midas_v21-f6b98070.pt") == "f6b98070");
  CHECK(hash_in_name("midas_v21_small-70d6b9c8.pt") == "70d6b9c8");
  CHECK(!hash_in_name("a-b/midas.pt"));
  CHECK(!hash_in_name("model-small.pt"));
  CHECK(!hash_in_name("model-beef.pt"));
  CHECK(!hash_in_name("model-.pt"));
  CHECK(!hash_in_name("f6b98070.pt"));

  const TemporaryFolder folder;
  const std::vector<std::byte> bytes = bytes_of_file(kFolder + "tiny_zip.pt");
  for (const auto& [name, warnings] : {std::pair("w-3aa34546df.pt", 0U), std::pair("w-00000000.pt", 1U)}) {
    write_bytes(folder.file(name), bytes);
    const ConvertReport report =
        convert(*open_weights(folder.file(name)), folder.file("out"), {.model = "any"});
    CHECK(report.warnings.size() == warnings);
    if (warnings > 0)
      CHECK(report.warnings[0].find("promises a SHA-256 that starts with 00000000") != std::string::npos);
  }
}

TEST_CASE("a listing shows every tensor, the total and the metadata") {
  const TemporaryFolder folder;
  write_safetensors(
      folder.file("w"),
      {{"conv.weight", Tensor::zeros(DType::kF32, {2, 3, 1, 1})}, {"n", Tensor::zeros(DType::kI64, {})}},
      {{"licence", "CC\x1b[0"}});
  const std::string text = listing(*open_weights(folder.file("w")));
  CHECK(text.find("conv.weight  F32    2x3x1x1     24\n") != std::string::npos);
  CHECK(text.find("n            I64    scalar       8\n") != std::string::npos);
  CHECK(text.find("2 tensors, 32 bytes, safetensors\n") != std::string::npos);
  CHECK(text.find("licence: CC?[0\n") != std::string::npos);
  CHECK(text.find("crc32c") == std::string::npos);
}

TEST_CASE("verification reads everything and says what it could compare") {
  CHECK(verify(*open_weights(kFolder + "zip.pt"))
            .find("26 tensors, the archive's checksums match, all values are finite") != std::string::npos);
  CHECK(verify(*open_weights(kFolder + "stream.pt")).find("26 tensors, it has no checksums, all") !=
        std::string::npos);
  const TemporaryFolder folder;
  write_safetensors(folder.file("w"), {{"a", Tensor::zeros(DType::kF32, {4})}});
  CHECK(verify(*open_weights(folder.file("w"))).find("all checksums match") != std::string::npos);
  std::vector<std::byte> bytes = bytes_of_file(folder.file("w"));
  bytes.back() ^= std::byte{1};
  write_bytes(folder.file("w"), bytes);
  CHECK(message_of([&] {
          static_cast<void>(verify(*open_weights(folder.file("w"))));
        }).find("does not match its checksum") != std::string::npos);
}
