#include <doctest/doctest.h>

#include "runtime/safetensors_writer.h"
#include "tests/examples/program.h"

using namespace slide;
using slide::test::ProgramResult;

namespace {

ProgramResult slide_convert(const std::vector<std::string>& arguments) {
  return slide::test::run_program(SLIDE_CONVERT, arguments);
}

}  // namespace

TEST_CASE("slide_convert replaces what it has made, and other files only with --overwrite") {
  const TemporaryFolder folder;
  const std::string source = SLIDE_TEST_DATA "/checkpoints/zip.pt";
  const std::string output = folder.file("w.safetensors");
  write_safetensors(output, {{"trained_for_weeks", Tensor::zeros(DType::kF32, {1})}});
  const std::vector<std::byte> before = bytes_of_file(output);
  const std::vector<std::string> call = {source, "--model", "any", "-o", output};
  const ProgramResult refused = slide_convert(call);
  CHECK(refused.code == 2);
  CHECK(refused.errors.find("w.safetensors exists, and SLIDE has not made it: it would be lost") !=
        std::string::npos);
  CHECK(refused.errors.find("--overwrite") != std::string::npos);
  CHECK(bytes_of_file(output) == before);
  CHECK(folder.entries() == 1);

  std::vector<std::string> forced = call;
  forced.emplace_back("--overwrite");
  CHECK(slide_convert(forced).code == 0);
  CHECK(bytes_of_file(output) != before);
  CHECK(slide_convert(call).code == 0);
  // No --overwrite for what is read, and none without an output.
  CHECK(slide_convert({output, "--model", "any", "-o", output, "--overwrite"}).code == 2);
  CHECK(slide_convert({output, "--list", "--overwrite"}).code == 2);
}
