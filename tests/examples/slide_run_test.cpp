#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string_view>

#include "render/codec.h"
#include "render/image_file.h"
#include "render/write_image.h"
#include "runtime/cpu.h"
#include "tests/examples/program.h"
#include "tests/render/phone_photo.h"
#include "weights/default_weights.h"

using namespace slide;
using slide::test::ProgramResult;

namespace {

namespace fs = std::filesystem;

ProgramResult slide_run(const std::vector<std::string>& arguments) {
  return slide::test::run_program(SLIDE_RUN, arguments);
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// A checkered wall behind a disc, 96×64, and its disparity.
struct Scene {
  explicit Scene(const TemporaryFolder& folder, double relief = 1)
      : photo(folder.file("photo.png")), depth(folder.file("depth.pfm")) {
    Image colour(96, 64, 3);
    Image disparity(96, 64, 1);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 96; ++x) {
        const bool disc = (x - 48) * (x - 48) + (y - 32) * (y - 32) < 300;
        disparity.at(x, y) = disc ? static_cast<float>(relief) : 0.0F;
        colour.at(x, y, 0) = disc ? 0.9F : 0.1F;
        colour.at(x, y, 1) = (x / 8 + y / 8) % 2 == 0 ? 0.6F : 0.3F;
        colour.at(x, y, 2) = disc ? 0.1F : 0.8F;
      }
    write_png(photo, colour);
    write_pfm(depth, disparity);
  }
  std::string photo, depth;
};

/// Where a scene's disc, the reddest there is, has its middle in the 96 columns from x0 on.
double disc(const Image& image, int x0) {
  double sum = 0;
  double count = 0;
  for (int x = 0; x < 96; ++x)
    if (image.at(x0 + x, 32, 0) > 0.7F) {
      sum += x;
      ++count;
    }
  return sum / count;
}

}  // namespace

TEST_CASE(
    "a photo with a depth map becomes a page, a model, an animation, a folder of frames and maps at once") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const ProgramResult result = slide_run({scene.photo,
                                          "--depth",
                                          scene.depth,
                                          "-o",
                                          folder.file("{}.html"),
                                          "-o",
                                          folder.file("{}.glb"),
                                          "-o",
                                          folder.file("{}.ply"),
                                          "-o",
                                          folder.file("{}.gif"),
                                          "-o",
                                          folder.file("frames"),
                                          "--frames",
                                          "5",
                                          "--layers",
                                          folder.file("layers"),
                                          "--dump-masks",
                                          folder.file("masks"),
                                          "--json"});
  REQUIRE_MESSAGE(result.code == 0, result.errors);
  const nlohmann::json report = nlohmann::json::parse(result.output)["photos"][0];
  for (const std::string output : report["outputs"]) CHECK_MESSAGE(fs::exists(output), output);
  for (const char* name :
       {"photo.html", "photo.glb", "photo.ply", "photo.gif", "frames/frame_0004.png", "layers/image.png",
        "layers/background.png", "layers/D.pfm", "layers/D1.pfm", "layers/A.pfm", "layers/S.pfm",
        "layers/S_hat.pfm", "layers/D_bg.pfm", "masks/photo.occlusion.png", "masks/photo.strokes.png"})
    CHECK_MESSAGE(fs::exists(folder.file(name)), name);
  CHECK(report["parallax_pixels"].get<double>() == doctest::Approx(96 * 0.04));
  CHECK(report["relief"] == true);
  CHECK(report["hole_fraction"].get<double>() > 0.01);
  CHECK(report["window_fraction"].get<double>() <= 1.0);
  // The background is never nearer than what covers it, and differs from the photo only where there is a
  // hole.
  const Image d1 = read_map(folder.file("layers/D1.pfm"));
  const Image d_bg = read_map(folder.file("layers/D_bg.pfm"));
  const Image rounded = read_map(folder.file("layers/D_bg.png"));
  REQUIRE(rounded.data.size() == d_bg.data.size());
  for (std::size_t i = 0; i < d_bg.data.size(); ++i)
    REQUIRE(std::abs(rounded.data[i] - d_bg.data[i]) <= 0.51 / 65535);
  for (std::size_t i = 0; i < d1.data.size(); ++i) REQUIRE(d_bg.data[i] <= d1.data[i]);
}

TEST_CASE("a scene without relief is one layer, and the report says that nothing was inpainted") {
  const TemporaryFolder folder;
  const Scene scene(folder, 0);
  const ProgramResult result = slide_run({scene.photo, "--depth", scene.depth, "-o", folder.file("{}.html"),
                                          "--layers", folder.file("layers"), "--json"});
  REQUIRE_MESSAGE(result.code == 0, result.errors);
  const nlohmann::json report = nlohmann::json::parse(result.output)["photos"][0];
  CHECK(report["relief"] == false);
  CHECK(contains(report["inpainting"], "none"));
  CHECK(!fs::exists(folder.file("layers/background.png")));
}

TEST_CASE("the network inside inpaints, or the fill alone") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto inpainting = [&](const std::vector<std::string>& more) {
    std::vector<std::string> call = {scene.photo,           "--depth",  scene.depth, "-o",
                                     folder.file("{}.y4m"), "--frames", "2",         "--json"};
    call.insert(call.end(), more.begin(), more.end());
    const ProgramResult result = slide_run(call);
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    return nlohmann::json::parse(result.output)["photos"][0]["inpainting"].get<std::string>();
  };
  const bool inside = !default_weights("slide_inpaint").empty();
  CHECK(inpainting({}) == (inside ? "slide_inpaint" : "fill"));
  CHECK(inpainting({"--inpaint-model", "fill"}) == "fill");
}

TEST_CASE("slide_matte's matte is refined by the network inside, another's is not, and none by choice") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto refines = [&](const std::vector<std::string>& more) {
    std::vector<std::string> call = {scene.photo,          "--matte", "auto", "--plan",
                                     "--saliency-weights", "formula"};
    call.insert(call.end(), more.begin(), more.end());
    const ProgramResult result = slide_run(call);
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    CHECK(contains(result.output, "saliency: "));
    return contains(result.output, "matting: ");
  };
  CHECK(refines({}) == !default_weights("slide_rim").empty());
  CHECK_FALSE(refines({"--matting-model", "none"}));
  CHECK_FALSE(refines({"--saliency-model", "u2netp"}));
  CHECK(refines({"--saliency-model", "u2netp", "--matting-weights", "formula", "--matting-model", "fba"}));
}

TEST_CASE("the depth map that a phone has put into a JPEG is used when asked for, and told of when not") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const std::vector<std::uint8_t> jpeg = encode_jpeg(read_photo(scene.photo).colour, 90);
  const std::vector<std::uint8_t> map = encode_png(read_map(scene.depth), 16);
  write_bytes(folder.file("phone.jpg"), phone::gdepth(jpeg, map, "GDepth:Near='1' GDepth:Far='9'"));
  write_bytes(folder.file("plain.jpg"), jpeg);
  const auto run = [&](const std::string& photo, const std::vector<std::string>& more) {
    std::vector<std::string> call = {folder.file(photo),
                                     "-o",
                                     folder.file("{}.y4m"),
                                     "--frames",
                                     "2",
                                     "--inpaint-model",
                                     "fill",
                                     "--layers",
                                     folder.file("layers")};
    call.insert(call.end(), more.begin(), more.end());
    return slide_run(call);
  };
  const ProgramResult used = run("phone.jpg", {"--depth", "embedded"});
  REQUIRE_MESSAGE(used.code == 0, used.errors);
  CHECK(contains(used.errors, "depth from the depth map in the photo"));
  // RangeInverse: black is near, and the disc of disparity 1 is white.
  const Image d = read_map(folder.file("layers/D.pfm"));
  CHECK(d.at(48, 32) == 0.0F);
  CHECK(d.at(2, 2) == 1.0F);
  const ProgramResult none = run("plain.jpg", {"--depth", "embedded"});
  CHECK(none.code == 3);
  CHECK(contains(none.errors, "plain.jpg holds no depth map"));
  const std::vector<std::string> network = {"--depth-weights", "formula", "--depth-model", "slide_depth"};
  const ProgramResult estimated = run("phone.jpg", network);
  REQUIRE_MESSAGE(estimated.code == 0, estimated.errors);
  CHECK(contains(estimated.errors, "--depth embedded uses it"));
  for (const char* photo : {"phone.jpg", "plain.jpg"}) {
    const ProgramResult either =
        run(photo, {"--depth", "auto", "--depth-weights", "formula", "--depth-model", "slide_depth"});
    REQUIRE_MESSAGE(either.code == 0, either.errors);
    CHECK(contains(either.errors, "depth from the depth map in the photo") == (photo[1] == 'h'));
  }
  CHECK(run("phone.jpg", {"--depth", "embedded", "--depth-kind", "depth"}).code == 2);
  CHECK(run("phone.jpg", {"--depth", "embedded", "--depth-model", "slide_depth"}).code == 2);
}

TEST_CASE("missing values of a depth map are filled, and the summary says how many") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  Image millimetres(96, 64, 1);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 96; ++x)
      millimetres.at(x, y) =
          (x - 48) * (x - 48) + (y - 32) * (y - 32) < 300 ? 500.0F / 65535 : 4000.0F / 65535;
  for (int x = 40; x < 50; ++x) millimetres.at(x, 30) = 0;  // inside the disc
  write_png(folder.file("mm.png"), millimetres, 16);
  const std::vector<std::string> call = {scene.photo,           "--depth",  folder.file("mm.png"),
                                         "--depth-kind",        "depth",    "-o",
                                         folder.file("{}.y4m"), "--frames", "2",
                                         "--inpaint-model",     "fill",     "--layers",
                                         folder.file("layers")};
  const ProgramResult result = slide_run(call);
  REQUIRE_MESSAGE(result.code == 0, result.errors);
  CHECK(contains(result.errors, "10 of 6144 values of " + folder.file("mm.png") + " were missing"));
  const Image d = read_map(folder.file("layers/D.pfm"));
  CHECK(d.at(45, 30) == doctest::Approx(1.0).epsilon(1e-5));
  CHECK(d.at(2, 2) == doctest::Approx(0.0));
}

TEST_CASE("a soft depth map is sharpened unless it is said to be sharp") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  Image soft(96, 64, 1);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 96; ++x) soft.at(x, y) = std::clamp((static_cast<float>(x) - 45) / 4, 0.0F, 1.0F);
  write_pfm(folder.file("soft.pfm"), soft);
  const auto steepest = [&](const std::string& edges) {
    const ProgramResult result =
        slide_run({scene.photo, "--depth", folder.file("soft.pfm"), "--depth-edges", edges, "--inpaint-model",
                   "fill", "-o", folder.file("a.glb"), "--layers", folder.file("layers"), "--explain"});
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    CHECK(contains(result.errors, "a jump of the map takes 4.0 pixels"));
    CHECK(contains(result.errors, "brought onto the photo's") == (edges != "sharp"));
    const Image d = read_map(folder.file("layers/D.pfm"));
    float step = 0;
    for (int x = 0; x + 1 < 96; ++x) step = std::max(step, d.at(x + 1, 32) - d.at(x, 32));
    return step;
  };
  CHECK(steepest("sharp") == doctest::Approx(0.25).epsilon(1e-4));
  CHECK(steepest("auto") > 0.4F);
  CHECK(steepest("soft") > 0.4F);
}

TEST_CASE("a page has the title and the description that it is given") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const ProgramResult result =
      slide_run({scene.photo, "--depth", scene.depth, "--inpaint-model", "fill", "-o", folder.file("a.html"),
                 "--title", "My disc", "--alt", "A <disc>"});
  REQUIRE_MESSAGE(result.code == 0, result.errors);
  const std::vector<std::uint8_t> bytes = read_file(folder.file("a.html"));
  const std::string page(bytes.begin(), bytes.end());
  CHECK(contains(page, "<title>My disc</title>"));
  CHECK(contains(page, "alt=\"A &lt;disc&gt;\""));
}

TEST_CASE("the same bytes come out at one and at three threads") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  for (const char* threads : {"1", "3"}) {
    const std::string out = folder.file(std::string("t") + threads);
    REQUIRE(slide_run({scene.photo, "--depth", scene.depth, "--threads", threads, "-o", out + ".glb", "-o",
                       out + ".gif", "-o", out + ".html", "--frames", "3", "-q"})
                .code == 0);
  }
  for (const char* extension : {".glb", ".gif", ".html"})
    CHECK_MESSAGE(bytes_of_file(folder.file(std::string("t1") + extension)) ==
                      bytes_of_file(folder.file(std::string("t3") + extension)),
                  extension);
}

TEST_CASE(
    "a folder's second photo uses the networks prepared for the first, and comes out as it does alone") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  fs::create_directory(folder.file("photos"));
  fs::copy_file(scene.photo, folder.file("photos/a.png"));
  fs::copy_file(scene.photo, folder.file("photos/b.png"));
  const auto run = [&](const std::string& input, const std::string& output) {
    const ProgramResult result = slide_run({input, "-o", folder.file(output), "--json"});
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    return nlohmann::json::parse(result.output);
  };
  const nlohmann::json report = run(folder.file("photos"), "{}.glb");
  const auto depth_of = [&](std::size_t photo) {
    for (const auto& stage : report["photos"][photo]["stages"])
      if (stage["name"] == "depth") return stage;
    return nlohmann::json();
  };
  CHECK(depth_of(0)["reused"] == false);
  CHECK(depth_of(0)["preparing_seconds"].get<double>() > 0);
  CHECK(depth_of(1)["reused"] == true);
  CHECK(depth_of(1)["preparing_seconds"] == 0);
  CHECK(depth_of(1)["memory_bytes"] == depth_of(0)["memory_bytes"]);
  const nlohmann::json alone = run(folder.file("photos/b.png"), "alone.glb");
  CHECK(bytes_of_file(folder.file("b.glb")) == bytes_of_file(folder.file("alone.glb")));
  // What is kept counts: the folder's photos are planned with more than the one alone.
  CHECK(report["photos"][1]["planned_memory_bytes"].get<double>() >
        alone["photos"][0]["planned_memory_bytes"].get<double>());
#if SLIDE_PLAIN_MEMORY  // no sanitizer's shadow memory, no emulator
  CHECK(report["peak_memory_bytes"].get<double>() <=
        report["photos"][1]["planned_memory_bytes"].get<double>());
#endif
}

TEST_CASE("one bad file does not stop the others, and the exit code says that some failed") {
  const TemporaryFolder folder;
  fs::create_directory(folder.file("photos"));
  const Scene scene(folder);
  fs::copy(scene.photo, folder.file("photos/good.png"));
  write_bytes(folder.file("photos/bad.jpg"), std::as_bytes(std::span("not a photo", 11)));
  const ProgramResult result = slide_run(
      {folder.file("photos"), "-o", folder.file("{}.y4m"), "--frames", "2", "--depth-weights", "formula",
       "--depth-model", "slide_depth", "--inpaint-weights", "formula", "--inpaint-model", "inpaint_coarse"});
  CHECK(result.code == 1);
  CHECK(contains(result.errors, "bad.jpg"));
  CHECK(contains(result.errors, "2 photos, 1 done, 1 failed"));
  CHECK(fs::exists(folder.file("good.y4m")));
  CHECK(!fs::exists(folder.file("bad.y4m")));
}

TEST_CASE("wrong calls are refused with exit code 2 before any work") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const std::vector<std::vector<std::string>> calls = {
      {},
      {scene.photo, "--no-such-flag"},
      {scene.photo, "--parallax", "80"},
      {scene.photo, "-o", folder.file("x.doc")},
      {scene.photo, "--stereo", "sbs", "-o", folder.file("x.glb")},
      {scene.photo, scene.photo, "-o", folder.file("x.gif")},
      {scene.photo, "--max-memory", "lots"},
      {scene.photo, "--title", "x", "-o", folder.file("x.gif")},
      {scene.photo, "--alt", "x", "--stereo", "sbs"},
      {scene.photo, "--size", "12x"},
      {scene.photo, "--glb-depth", "deep", "-o", folder.file("x.glb")},
      {scene.photo, "--isa", "mmx"},
      {scene.photo, "--isa", "baseline,-mmx"},
      {scene.photo, "--depth-model", "midas_v21"},
      {scene.photo, "--inpaint-model", "fill", "--inpaint-weights", "formula"},
      {scene.photo, "--depth", scene.depth, "--near", "5", "--far", "2"},
      {scene.photo, "--depth", scene.depth, "--depth-kind", "deep"},
      {scene.photo, "--depth", scene.depth, "--maxpool", "4"},
      {scene.photo, "--depth", scene.depth, "--path", "spiral"},
      // out of range, or no number
      {scene.photo, "--sigma", "1e9"},
      {scene.photo, "--gamma", "1e308"},
      {scene.photo, "--rho", "inf"},
      {scene.photo, "--beta", "-1"},
      {scene.photo, "--near", "nan"},
      {scene.photo, "--mesh-tolerance", "nan", "-o", folder.file("x.gif")},
      {scene.photo, "--parallax", "nan"},
      // contradictory, or without effect
      {scene.photo, "--saliency-weights", "formula"},
      {scene.photo, "--matting-model", "fba"},
      {scene.photo, "--matte", "auto", "--matting-model", "none", "--matting-weights", "formula"},
      {scene.photo, "--depth", scene.depth, "--depth-weights", "formula"},
      {scene.photo, "--depth-kind", "depth"},
      {scene.photo, "--depth-edges", "soft"},
      {scene.photo, "--depth", scene.depth, "--depth-edges", "blurred"},
      {scene.photo, "--depth", scene.depth, "--depth-size", "384"},
      {scene.photo, "--depth-size", "400"},
      {scene.photo, "--depth-size", "512", "--depth-weights", "formula", "--depth-model",
       "depth_anything_v2_vits"},
      {scene.photo, "--path", "swing", "--stereo", "sbs"},
      {scene.photo, "--frames", "9", "--stereo", "sbs"},
      {scene.photo, "--fps", "25"},
      {scene.photo, "--size", "64", "-o", folder.file("x.glb")},
      {scene.photo, "--glb-depth", "true"},
      {scene.photo, "--glb-depth", "relief", "-o", folder.file("x.gif")},
      {scene.photo, "--path", "poses.json", "--parallax", "3", "-o", folder.file("x.gif")},
      {scene.photo, "--path", "poses.json", "--focus", "1", "-o", folder.file("x.glb")},
      {scene.photo, "--depth", scene.depth, "--inpaint-model", "fill", "--precision", "bf16"},
      {scene.photo, "--depth", scene.depth, "--inpaint-model", "fill", "--error-budget", "0.1"},
      {scene.photo, "--explain", "--json"},
      {scene.photo, "--explain", "-q"},
      {scene.photo, "--explain", "--plan"},
      // the camera looks past the photo
      {scene.photo, "--depth", scene.depth, "--parallax", "50", "--focus", "1", "--fov", "170"},
  };
  for (const auto& call : calls) {
    const ProgramResult result = slide_run(call);
    CHECK_MESSAGE(result.code == 2, result.errors);
    CHECK(!result.errors.empty());
  }
  CHECK(folder.entries() == 2);
}

TEST_CASE(
    "bad inputs, bad weights and too little memory have their own exit codes, and leave nothing behind") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  CHECK(slide_run({folder.file("missing.jpg")}).code == 3);
  Image infinite(96, 64, 1, 0.5F);
  infinite.at(7, 3) = std::numeric_limits<float>::infinity();
  write_pfm(folder.file("inf.pfm"), infinite);
  const ProgramResult bad_depth = slide_run({scene.photo, "--depth", folder.file("inf.pfm")});
  CHECK(bad_depth.code == 3);
  CHECK(contains(bad_depth.errors, "(7, 3)"));
  write_bytes(folder.file("w.safetensors"), std::as_bytes(std::span("nonsense", 8)));
  CHECK(slide_run({scene.photo, "--depth-weights", folder.file("w.safetensors")}).code == 4);
  const ProgramResult memory = slide_run({scene.photo, "--depth", scene.depth, "--max-memory", "20M"});
  CHECK(memory.code == 5);
  CHECK(contains(memory.errors, "MiB"));
  // What a map's header promises is refused before there is any memory for it, be the file that long or not.
  const std::string_view header = "Pf\n11000 11000\n-1\n";
  write_bytes(folder.file("huge.pfm"), std::as_bytes(std::span(header)));
  for (const char* option : {"--depth", "--matte"}) {
    const ProgramResult map = slide_run({scene.photo, option, folder.file("huge.pfm"), "--max-memory", "1G"});
    CHECK(map.code == 5);
    CHECK(contains(map.errors, "huge.pfm has 11000x11000 pixels"));
  }
  CHECK(folder.entries() == 5);
}

TEST_CASE("no more memory is used than was planned") {
  const TemporaryFolder folder;
  Image colour(640, 480, 3, 0.5F);
  Image disparity(640, 480, 1);
  for (int y = 100; y < 300; ++y)
    for (int x = 200; x < 400; ++x) disparity.at(x, y) = 1;
  write_png(folder.file("p.png"), colour);
  write_pfm(folder.file("d.pfm"), disparity);
  for (const char* output : {"o.y4m", "o.glb", "o.html", "o.gif"}) {
    const ProgramResult result = slide_run({folder.file("p.png"), "--depth", folder.file("d.pfm"), "--frames",
                                            "3", "-o", folder.file(output), "--json"});
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    const nlohmann::json report = nlohmann::json::parse(result.output);
#if SLIDE_PLAIN_MEMORY  // no sanitizer's shadow memory, no emulator
    CHECK_MESSAGE(report["peak_memory_bytes"].get<double>() <=
                      report["photos"][0]["planned_memory_bytes"].get<double>(),
                  std::string(output));
#endif
  }
}

TEST_CASE("lower precisions predict a larger error, a budget bounds it, and the report tells") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto depth_stage = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {scene.photo, "-o", folder.file("out.png"),
                                          "--frames",  "2",  "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = slide_run(arguments);
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    return nlohmann::json::parse(result.output)["photos"][0]["stages"][1];
  };
  const nlohmann::json fp32 = depth_stage({});
  CHECK(fp32["name"] == "depth");
  CHECK(fp32["bf16_layers"] == 0);
  CHECK(fp32["int8_layers"] == 0);
  CHECK(fp32["predicted_error"] < 2e-5);  // roundings of the network and of what sharpens edges
  const nlohmann::json bf16 = depth_stage({"--precision", "bf16"});
  const nlohmann::json int8 = depth_stage({"--precision", "int8"});
  // Where lower precisions are emulated, they save nothing and no plan takes them.
  const bool all_pay = runs_at(Isa::kAmx, active_isa());
  if (all_pay || bf16["bf16_layers"] > 0) CHECK(bf16["predicted_error"] > 1e-3);
  if (all_pay || int8["int8_layers"] > 0) CHECK(int8["predicted_error"] > bf16["predicted_error"]);
  if (all_pay) {
    CHECK(bf16["bf16_layers"] > 10);
    CHECK(int8["int8_layers"] > 10);
  }
  CHECK(depth_stage({"--precision", "auto"})["predicted_error"] <= 1e-2);
  CHECK(depth_stage({"--error-budget", "1e-3"})["predicted_error"] <= 1e-3);

  const ProgramResult plan = slide_run({scene.photo, "--precision", "int8", "--plan"});
  CHECK(plan.code == 0);
  CHECK(contains(plan.output, "predicted error"));
  CHECK(contains(plan.output, "sensitivity"));
  CHECK(contains(plan.output, "conv2d.direct_int8") == (int8["int8_layers"] > 0));
  for (const std::vector<std::string>& wrong : {std::vector<std::string>{"--precision", "fp8"},
                                                {"--error-budget", "0"},
                                                {"--error-budget", "nan"},
                                                {"--error-budget", "1.01"},
                                                {"--precision", "fp32", "--error-budget", "1e-7"}}) {
    std::vector<std::string> arguments = {scene.photo, "-o", folder.file("out.png")};
    arguments.insert(arguments.end(), wrong.begin(), wrong.end());
    CHECK_MESSAGE(slide_run(arguments).code == 2, wrong.back());
  }
}

TEST_CASE("no output replaces an input, and each -o takes one name") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto bytes = [](const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const std::string before = bytes(scene.photo);
  const std::string other = folder.file("other.png"), link = folder.file("link.gif");
  fs::copy_file(scene.photo, other);
  fs::copy_file(scene.photo, folder.file("photo.jpg"));
  fs::create_symlink(scene.photo, link);
  const std::vector<std::vector<std::string>> calls = {
      {scene.photo, "-o", scene.photo},
      {scene.photo, "-o", link},
      {scene.photo, "-o", folder.file("PHOTO.PNG")},
      {scene.photo, "-o", folder.file("a.gif"), other},
      {scene.photo, folder.file("photo.jpg"), "-o", folder.file("{}.gif")},
      {scene.photo, "--depth", scene.depth, "-o", folder.file("./photo.png")}};
  for (const std::vector<std::string>& call : calls) {
    const ProgramResult result = slide_run(call);
    CHECK_MESSAGE(result.code == 2, result.errors);
  }
  CHECK(bytes(scene.photo) == before);
  CHECK(bytes(other) == before);
  const ProgramResult first = slide_run({"-o", folder.file("x.html"), scene.photo, "-q"});
  CHECK_MESSAGE(first.code == 0, first.errors);
  CHECK(fs::exists(folder.file("x.html")));
}

TEST_CASE("what SLIDE has not made is replaced only with --overwrite, what it has made always") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  fs::create_directory(folder.file("layers"));
  fs::create_directory(folder.file("frames"));
  // Another program's files: a PNG without SLIDE's mark, and text.
  const std::string png_of_others = SLIDE_TEST_DATA "/images/rgb_8.png";
  const std::vector<std::string> outputs = {"a.png", "a.gif", "a.html", "a.glb", "a.ply", "a.y4m"};
  fs::copy_file(png_of_others, folder.file("s.png"));
  for (const std::string& name : outputs) fs::copy_file(png_of_others, folder.file(name));
  fs::copy_file(png_of_others, folder.file("layers/image.png"));
  fs::copy_file(png_of_others, folder.file("frames/frame_0001.png"));
  std::vector<std::vector<std::string>> calls;
  for (const std::string& name : outputs) calls.push_back({"-o", folder.file(name)});
  calls.push_back({"-o", folder.file("frames/")});
  calls.push_back({"-o", folder.file("b.y4m"), "--layers", folder.file("layers")});
  calls.push_back({"-o", folder.file("s.png"), "--stereo", "sbs"});
  const auto run = [&](std::vector<std::string> call, bool overwrite) {
    call.insert(call.begin(), {scene.photo, "--depth", scene.depth, "-q", "--inpaint-model", "fill"});
    if (overwrite) call.push_back("--overwrite");
    const ProgramResult result = slide_run(call);
    if (!overwrite && result.code == 2) CHECK(contains(result.errors, "--overwrite"));
    return result.code;
  };
  for (const auto& call : calls) {
    CAPTURE(call[1]);
    CHECK(run(call, false) == 2);
  }
  std::vector<std::string> all = {
      "--frames", "3", "--layers", folder.file("layers"), "-o", folder.file("frames/")};
  for (const std::string& name : outputs) all.insert(all.end(), {"-o", folder.file(name)});
  for (const std::vector<std::string>& call : {all, calls.back()}) {
    CHECK(run(call, true) == 0);
    CHECK(run(call, false) == 0);
  }
  // No --overwrite for an input.
  CHECK(run({"-o", scene.photo}, true) == 2);
  fs::copy_file(scene.photo, folder.file("frames/frame_0002.png"), fs::copy_options::overwrite_existing);
  CHECK(slide_run({folder.file("frames/frame_0002.png"), "-o", folder.file("frames/"), "--overwrite"}).code ==
        2);
}

TEST_CASE("links that lead nowhere fail as one photo among others") {
  const TemporaryFolder folder;
  fs::create_directory(folder.file("photos"));
  const Scene scene(folder);
  fs::copy(scene.photo, folder.file("photos/good.png"));
  fs::create_symlink("loop.jpg", folder.file("photos/loop.jpg"));
  fs::create_symlink("none.jpg", folder.file("photos/nowhere.jpg"));
  fs::create_symlink("link", folder.file("link"));
  fs::copy(scene.photo, folder.file("photos/._good.png"));  // no photo: macOS's notes about good.png
  const ProgramResult result =
      slide_run({folder.file("photos"), folder.file("link"), "-o", folder.file("{}.y4m"), "--frames", "2",
                 "--depth-weights", "formula", "--depth-model", "slide_depth", "--inpaint-model", "fill"});
  CHECK(result.code == 1);
  CHECK(contains(result.errors, "4 photos, 1 done, 3 failed"));
  CHECK(fs::exists(folder.file("good.y4m")));
}

#if SLIDE_PLAIN_MEMORY  // no sanitizer's shadow memory, no emulator
TEST_CASE("every usual extension is a photo in a folder") {
  const TemporaryFolder folder;
  fs::create_directory(folder.file("photos"));
  const Scene scene(folder);
  for (const char* name : {"a.jfif", "b.heif", "c.AVIF", "d.txt"})
    fs::copy(scene.photo, folder.file(std::string("photos/") + name));
  const ProgramResult result =
      slide_run({folder.file("photos"), "-o", folder.file("{}.y4m"), "--frames", "2", "--depth-weights",
                 "formula", "--depth-model", "slide_depth", "--inpaint-model", "fill"});
  CHECK_MESSAGE(result.code == 0, result.errors);
  CHECK(contains(result.errors, "3 photos, 3 done"));
}

TEST_CASE("a photo comes from standard input, from a pipe or a file, and its output has a name") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto piped = [&](const std::string& script, const std::vector<std::string>& more) {
    std::vector<std::string> call = {"-c", script, SLIDE_RUN, scene.photo, "-"};
    call.insert(call.end(), more.begin(), more.end());
    return slide::test::run_program("sh", call);
  };
  const std::string pipe = R"(photo=$1; shift; cat "$photo" | exec "$0" "$@")";
  const std::string redirected = R"(photo=$1; shift; exec "$0" "$@" <"$photo")";
  std::vector<std::string> call = {"--depth",         scene.depth, "--frames", "2",
                                   "--inpaint-model", "fill",      "-o",       folder.file("1{}.y4m"),
                                   "--max-side",      "48"};
  const ProgramResult first = piped(pipe, call);
  REQUIRE_MESSAGE(first.code == 0, first.errors);
  CHECK(contains(first.errors, "reduced from 96x64 (a larger --max-side"));
  call[7] = folder.file("2.y4m");
  REQUIRE(piped(redirected, call).code == 0);
  CHECK(bytes_of_file(folder.file("1photo.y4m")) == bytes_of_file(folder.file("2.y4m")));
  const ProgramResult no_name = piped(pipe, {"--depth", scene.depth});
  CHECK(no_name.code == 2);
  CHECK(contains(no_name.errors, "-o"));
  const ProgramResult empty = piped(R"(shift; : | exec "$0" "$@")", call);
  CHECK(empty.code == 3);
  CHECK(contains(empty.errors, "standard input is empty"));
  CHECK(piped(R"(shift; exec "$0" "$@" </dev/zero)", call).code == 3);
}

TEST_CASE("threads that cannot be started are exit code 5") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const ProgramResult result = slide::test::run_program(
      "sh", {"-c", "ulimit -v 4000000; exec \"$0\" \"$@\"", SLIDE_RUN, scene.photo, "--depth", scene.depth,
             "--threads", "1000", "-o", folder.file("x.gif"), "-q"});
  CHECK(result.code == 5);
  CHECK(contains(result.errors, "threads"));
  CHECK(folder.entries() == 2);
}
#endif

TEST_CASE("a GIF is small unless a size or a rate is asked for") {
  const TemporaryFolder folder;
  write_png(folder.file("p.png"), Image(640, 320, 3, 0.5F));
  write_pfm(folder.file("d.pfm"), Image(640, 320, 1, 0.5F));
  struct Gif {
    int width, height, frames, delay;
  };
  const auto made = [&](const std::vector<std::string>& more) {
    std::vector<std::string> call = {
        folder.file("p.png"), "--depth", folder.file("d.pfm"), "-o", folder.file("g.gif"), "--frames", "6"};
    call.insert(call.end(), more.begin(), more.end());
    const ProgramResult result = slide_run(call);
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    CHECK(contains(result.errors, "g.gif ("));
    std::ifstream file(folder.file("g.gif"), std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    const auto u16 = [&](std::size_t at) {
      return static_cast<unsigned char>(bytes[at]) + 256 * static_cast<unsigned char>(bytes[at + 1]);
    };
    Gif gif{u16(6), u16(8), 0, 0};
    const std::string control = "\x21\xF9\x04";
    for (std::size_t at = bytes.find(control); at != std::string::npos; at = bytes.find(control, at + 1)) {
      ++gif.frames;
      if (gif.delay == 0) gif.delay = u16(at + 4);
    }
    return gif;
  };
  const Gif small = made({});
  CHECK(small.width == 480);
  CHECK(small.height == 240);
  CHECK(small.frames == 3);
  CHECK(small.delay == 7);  // hundredths, of a 15th
  const Gif asked = made({"--size", "640", "--fps", "25"});
  CHECK(asked.width == 640);
  CHECK(asked.frames == 6);
  CHECK(asked.delay == 4);
}

TEST_CASE("stereo stills have the shape they should, and the left eye sees what is near further right") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto still = [&](const std::string& kind, const std::string& name) {
    const ProgramResult result = slide_run({scene.photo, "--depth", scene.depth, "--inpaint-model", "fill",
                                            "--stereo", kind, "-o", folder.file(name), "-q"});
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    return read_photo(folder.file(name)).colour;
  };
  const Image sbs = still("sbs", "s.png");
  CHECK((sbs.width == 192 && sbs.height == 64));
  CHECK(still("anaglyph", "a.jpg").width == 96);
  CHECK(still("half-sbs", "h.png").width == 96);
  CHECK(still("tb", "t.png").height == 128);
  CHECK(still("half-tb", "ht.png").height == 64);
  CHECK(disc(sbs, 0) > disc(sbs, 96) + 2);
  const Image cross = still("cross", "c.png");
  CHECK(disc(cross, 0) == disc(sbs, 96));
  CHECK(disc(cross, 96) == disc(sbs, 0));
}

TEST_CASE("a stereo video has both eyes in each frame, and the layers for all of them") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const auto run = [&](const std::vector<std::string>& more) {
    std::vector<std::string> call = {
        scene.photo,  "--depth", scene.depth,    "--inpaint-model",  "fill", "--stereo", "sbs",
        "--parallax", "8",       "--keep-edges", "--mesh-tolerance", "0",    "--json"};
    call.insert(call.end(), more.begin(), more.end());
    const ProgramResult result = slide_run(call);
    REQUIRE_MESSAGE(result.code == 0, result.errors);
    return nlohmann::json::parse(result.output)["photos"][0];
  };
  const nlohmann::json report = run(
      {"--path", "swing", "--frames", "4", "-o", folder.file("frames") + "/", "-o", folder.file("s.gif")});
  CHECK(fs::exists(folder.file("s.gif")));
  // Path and eyes share the parallax: at the swing's ends one eye is all of it away, 0.08 · 96 pixels.
  CHECK(report["parallax_pixels"].get<double>() == doctest::Approx(0.08 * 96));
  const auto frame = [&](int i) {
    return read_photo(folder.file("frames/frame_000" + std::to_string(i) + ".png")).colour;
  };
  REQUIRE((frame(0).width == 192 && frame(0).height == 64));
  CHECK(!fs::exists(folder.file("frames/frame_0004.png")));
  // Against the plane that stands still, at disparity 0.5, the disc moves by half of the parallax in pixels:
  // each eye by 0.04 · 96 / 2 = 1.92 to its side, the camera by as much at the ends of its swing.
  CHECK(disc(frame(0), 0) - disc(frame(0), 96) == doctest::Approx(2 * 1.92).epsilon(0.15));
  CHECK(disc(frame(3), 0) - disc(frame(1), 0) == doctest::Approx(2 * 1.92).epsilon(0.15));
  // One eye where the camera began is where the other one is half a swing later.
  const Image right_end = frame(1);
  const Image left_end = frame(3);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 96; ++x)
      REQUIRE(right_end.at(x, y, 1) == doctest::Approx(left_end.at(96 + x, y, 1)).epsilon(0.02));
}

TEST_CASE("an output that cannot be written has an exit code of its own, and nothing stays") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const std::vector<std::string> call = {scene.photo, "--depth",         scene.depth, "--frames",
                                         "2",         "--inpaint-model", "fill",      "-o"};
  const auto run = [&](const std::string& output, const std::string& standard_output) {
    std::vector<std::string> arguments = call;
    arguments.push_back(output);
    if (output != "-") arguments.emplace_back("--json");
    return slide::test::run_program(SLIDE_RUN, arguments, standard_output);
  };
  const ProgramResult frames = run("-", "/dev/full");
  CHECK(frames.code == 7);
  CHECK(contains(frames.errors, "No space left"));
  CHECK(run(folder.file("a.png"), "/dev/full").code == 7);
  CHECK(fs::remove(folder.file("a.png")));
  const ProgramResult no_folder = run(scene.photo + "/a.gif", "");
  CHECK(no_folder.code == 7);
  CHECK(contains(no_folder.errors, "photo.png/a.gif"));
  CHECK(folder.entries() == 2);
}

TEST_CASE("frames can go to standard output") {
  const TemporaryFolder folder;
  const Scene scene(folder);
  const ProgramResult result = slide_run({scene.photo, "--depth", scene.depth, "-o", "-", "--frames", "2"});
  CHECK(result.code == 0);
  CHECK(result.output.starts_with("YUV4MPEG2 W96 H64"));
}

TEST_CASE("help shows the defaults, version shows the build, plan shows the kernels") {
  const ProgramResult help = slide_run({"--help"});
  CHECK(help.code == 0);
  CHECK(contains(help.output, "--parallax"));
  CHECK(contains(help.output, "=4"));
  CHECK(contains(help.output, "Examples:"));
  CHECK(contains(slide_run({"--version"}).output, "instruction set:"));
  CHECK(contains(slide_run({"--version"}).output, "features: " + text_of(detected_features())));
  const TemporaryFolder folder;
  const Scene scene(folder);
  const ProgramResult plan =
      slide_run({scene.photo, "--depth-weights", "formula", "--depth-model", "midas_v21_small", "--plan"});
  CHECK(plan.code == 0);
  CHECK(contains(plan.output, "depth: "));
  CHECK(contains(plan.output, "conv2d.direct"));
  CHECK(contains(plan.output, "residual"));      // convolutions with what was fused into them
  CHECK(!contains(plan.output, "batch_norm."));  // no kernel runs one
  CHECK(contains(plan.output, "GFLOP done"));
  CHECK(contains(plan.output, "at the peak"));
  CHECK(folder.entries() == 2);
}
