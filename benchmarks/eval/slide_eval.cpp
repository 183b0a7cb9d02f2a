// slide_eval: how close a rendered view comes to a picture taken from there. Scenes are stereo pairs with
// measured disparity, pictures with known cameras, and subjects with a true matte before a known background.
// What is compared where is said in docs/views.md.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "benchmarks/eval/report.h"
#include "benchmarks/eval/result.h"
#include "examples/network_files.h"
#include "render/image_file.h"
#include "runtime/error.h"
#include "runtime/safetensors.h"

namespace {

using namespace slide;
using namespace slide::eval;
namespace fs = std::filesystem;

struct Arguments {
  std::vector<std::string> scenes;
  std::string out, depth_weights, inpaint_weights, saliency_weights, lpips, ablate;
  bool json = false;
};

/// A folder with scene.json, or a matte scene's NAME_alpha.png.
std::vector<std::string> find_scenes(const std::vector<std::string>& folders) {
  std::vector<std::string> found;
  const auto is_matte = [](const fs::path& p) { return p.filename().string().ends_with("_alpha.png"); };
  for (const std::string& folder : folders) {
    const std::size_t before = found.size();
    if (fs::exists(fs::path(folder) / "scene.json") || is_matte(folder)) found.push_back(folder);
    std::error_code failure;
    std::vector<std::string> inside;
    for (const auto& entry : fs::directory_iterator(folder, failure))
      if (fs::exists(entry.path() / "scene.json") || is_matte(entry.path()))
        inside.push_back(entry.path().string());
    std::ranges::sort(inside);
    found.insert(found.end(), inside.begin(), inside.end());
    if (found.size() == before)
      throw Error(ErrorKind::kBadInput, folder + " holds no scene",
                  "a scene is a folder with scene.json, or NAME_alpha.png with NAME_fg.jpg and NAME_bg.jpg");
  }
  return found;
}

/// What scene.json says of itself; a stereo scene need not.
std::string kind_of(const std::string& folder) try {
  const auto bytes = read_file(folder + "/scene.json");
  return nlohmann::json::parse(bytes.begin(), bytes.end()).value("kind", std::string("stereo"));
} catch (const nlohmann::json::exception& e) {
  throw Error(ErrorKind::kBadInput, folder + "/scene.json: " + e.what());
}

std::vector<SceneResult> run_scene(const std::string& scene, const Settings& settings) {
  if (scene.ends_with("_alpha.png")) return {run_matte(scene, settings)};
  const std::string kind = kind_of(scene);
  if (kind == "stereo") return {run_stereo(scene, settings)};
  if (kind == "posed") return run_posed(scene, settings);
  throw Error(ErrorKind::kBadInput, scene + "/scene.json: there is no kind of scene \"" + kind + "\"",
              "one of: stereo, posed");
}

/// All scenes; pictures are written at once and let go.
std::vector<SceneResult> run_scenes(const std::vector<std::string>& scenes, const Settings& settings,
                                    const std::string& out, bool quiet) {
  std::vector<SceneResult> results;
  for (const std::string& scene : scenes)
    for (SceneResult& r : run_scene(scene, settings)) {
      if (!out.empty()) write_pictures(out, r);
      if (!quiet) print(r);
      for (Entry& e : r.entries) e.view = {};
      r.truth = r.interesting = {};
      results.push_back(std::move(r));
    }
  return results;
}

/// An option of the layering and the values it takes one after the other: "beta=0.05,0.1".
struct Ablation {
  std::string option;
  std::vector<double> values;
};

Ablation parse_ablation(const std::string& text) {
  const std::size_t equals = text.find('=');
  Ablation out{text.substr(0, equals), {}};
  std::istringstream values(equals == std::string::npos ? "" : text.substr(equals + 1));
  for (std::string value; std::getline(values, value, ',');) {
    std::size_t end = 0;
    try {
      out.values.push_back(std::stod(value, &end));
    } catch (const std::exception&) {
      end = 0;
    }
    if (end != value.size() || value.empty())
      throw Error(ErrorKind::kUsage, "--ablate: \"" + value + "\" is no number");
  }
  if (out.values.empty())
    throw Error(ErrorKind::kUsage, "--ablate needs an option and values", "such as beta=0.05,0.083,0.2");
  return out;
}

void set(LayeringChoice& layering, const std::string& option, double value) {
  if (option == "beta")
    layering.beta = value;
  else if (option == "gamma")
    layering.gamma = value;
  else if (option == "rho")
    layering.rho = value;
  else if (option == "sigma")
    layering.sigma = value;
  else if (option == "maxpool")
    layering.maxpool = static_cast<std::int64_t>(value);
  else
    throw Error(ErrorKind::kUsage, "--ablate: there is no option \"" + option + "\"",
                "one of: beta, gamma, rho, sigma, maxpool");
}

void run_ablation(const Ablation& ablation, const std::vector<std::string>& scenes, Settings settings,
                  bool as_json) {
  nlohmann::json all = nlohmann::json::array();
  for (const double value : ablation.values) {
    set(settings.layering, ablation.option, value);
    const std::vector<SceneResult> results = run_scenes(scenes, settings, "", true);
    if (as_json) {
      all.push_back({{"option", ablation.option}, {"value", value}, {"means", to_json(results)["means"]}});
    } else {
      std::printf("\n%s = %g\n", ablation.option.c_str(), value);
      print_means(results);
    }
  }
  if (as_json) std::cout << all.dump(1) << "\n";
}

void declare(CLI::App& app, Arguments& a, Settings& s) {
  app.add_option("SCENES", a.scenes, "scenes, or folders of scenes (docs/views.md)")->required();
  app.add_option("--out", a.out, "write the views and a strip of cut-outs of each scene here");
  app.add_flag("--json", a.json, "print JSON");
  app.add_option("--only", s.only, "only methods with this in their names, such as \"soft\"");
  app.add_option("--depth-weights", a.depth_weights, "weights of the depth network; default: built in");
  app.add_option("--inpaint-weights", a.inpaint_weights,
                 "weights of the inpainting network; default: built in");
  app.add_option("--saliency-weights", a.saliency_weights,
                 "weights of the saliency network, for matte scenes; default: built in");
  app.add_option("--lpips", a.lpips,
                 "LPIPS, too: safetensors of PyPI's lpips.LPIPS(net=\"alex\").state_dict()");
  app.add_option("--depth-edges", s.depth_edges,
                 "of the scenes' depth maps, as slide_run takes it; default sharp")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, graphs::DepthEdges>{{"sharp", graphs::DepthEdges::kSharp},
                                                    {"soft", graphs::DepthEdges::kSoft},
                                                    {"auto", graphs::DepthEdges::kAuto}}));
  app.add_option("--beta", s.layering.beta, "steepness of the visibility, as part of P^2; default 1/12");
  app.add_option("--gamma", s.layering.gamma, "steepness of the disocclusion, as multiple of P; default 1");
  app.add_option("--rho", s.layering.rho, "disparity a pixel is worth, as multiple of 1/P; default 1");
  app.add_option("--sigma", s.layering.sigma, "conditioning blur, pixels")->capture_default_str();
  app.add_option("--maxpool", s.layering.maxpool, "side of the conditioning max-pool")->capture_default_str();
  app.add_option("--ablate", a.ablate,
                 "OPTION=VALUE,...: the means with each value of beta, gamma, rho, sigma or maxpool");
}

int run(CLI::App& app, int argc, char** argv) {
  Arguments a;
  Settings settings;
  declare(app, a, settings);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  if (!a.ablate.empty() && !a.out.empty())
    throw Error(ErrorKind::kUsage, "--ablate writes no pictures", "leave --out out");
  NetworkFiles files;
  settings.models.depth = files.open(a.depth_weights, "", "slide_depth", "depth");
  settings.models.inpaint = files.open(a.inpaint_weights, "", "slide_inpaint", "inpaint");
  settings.models.saliency = files.open(a.saliency_weights, "", "slide_matte", "saliency");
  settings.models.matting = files.open("", "", default_refiner(settings.models.saliency), "matting");
  std::optional<SafetensorsWeights> lpips;
  if (!a.lpips.empty()) settings.lpips = &lpips.emplace(a.lpips);
  const std::vector<std::string> scenes = find_scenes(a.scenes);
  if (!a.ablate.empty()) {
    run_ablation(parse_ablation(a.ablate), scenes, settings, a.json);
    return 0;
  }
  const std::vector<SceneResult> results = run_scenes(scenes, settings, a.out, a.json);
  if (a.json)
    std::cout << to_json(results).dump(1) << "\n";
  else if (results.size() > 1)
    print_means(results);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    CLI::App app("Renders views of scenes whose views are known, and says how close they come.");
    return run(app, argc, argv);
  } catch (const Error& e) {
    std::cerr << "slide_eval: " << e.what() << "\n";
    return exit_code(e.kind());
  } catch (const std::exception& e) {
    std::cerr << "slide_eval: internal error: " << e.what() << "\n";
    return exit_code(ErrorKind::kInternal);
  }
}
