#include "examples/slide_run/options.h"

#include <cmath>
#include <limits>

#include "examples/cli_docs.h"
#include "graphs/layering.h"
#include "runtime/error.h"

namespace slide::run {
namespace {

constexpr const char* kExamples = R"(Examples:
  slide_run photo.jpg                                  photo.3d.html: open it, move the mouse
  slide_run photo.jpg -o photo.gif -o photo.glb        an animation and a 3D model
  slide_run photo.jpg --parallax 6 --path swing -o photo.mp4
  slide_run photo.jpg --depth depth.png --depth-kind depth
  slide_run photo.jpg --stereo anaglyph -o photo.png   for red-cyan glasses
  slide_run holiday/ -o 'out/{}.html'                  every photo of a folder
  slide_run photo.jpg -o - | ffplay -                  frames into a pipe
  curl https://example.org/photo.jpg | slide_run - -o photo.html

Exit codes: 0 done, 1 some inputs failed, 2 usage, 3 bad input file, 4 bad weights, 5 out of memory or over
--max-memory, 6 internal error, 7 an output could not be written.)";

/// CLI::Range for numbers that may not be "nan", which it lets through.
CLI::Validator within(double low, double high) {
  const std::string range = CLI::detail::to_string(low) + " to " + CLI::detail::to_string(high);
  return CLI::Validator(
      [=](const std::string& text) {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && value >= low && value <= high;
        return good ? std::string() : "'" + text + "' is not a number in " + range;
      },
      range);
}

void declare_input(CLI::App& app, Options& o) {
  app.add_option("photo", o.inputs, "Photos, folders of photos, or - for a JPEG or PNG on standard input")
      ->type_name("FILE");
  const char* group = "Input";
  app.add_option(
         "--depth", o.depth,
         "Depth map of the photo instead of a depth network: a file (PNG, PFM, NPY, EXR), embedded (the map "
         "that "
         "a phone has put into a portrait JPEG), or auto (that map where there is one, else the network)")
      ->group(group)
      ->type_name("FILE|embedded|auto");
  app.add_option(
         "--depth-kind", o.depth_kind,
         "What its numbers are: disparity (larger is nearer), inverted (larger is farther, as pictures in "
         "which black is near) or depth (distances, 0 where there is none). NaN is a missing value, too")
      ->group(group)
      ->capture_default_str();
  app.add_option("--depth-edges", o.depth_edges,
                 "The map's edges: soft (brought onto the photo's, as a network's are), sharp (left as they "
                 "are), or auto: "
                 "soft if most of its jumps take several pixels")
      ->group(group)
      ->check(CLI::IsMember({"sharp", "soft", "auto"}))
      ->capture_default_str();
  app.add_option(
         "--matte", o.matte,
         "Alpha matte of the subject, for its outline and for what is filled in behind it: a file, auto "
         "(found if something stands out), none")
      ->group(group)
      ->type_name("FILE|auto|none")
      ->capture_default_str();
  app.add_option("--max-side", o.max_side,
                 "Larger photos are reduced to this many pixels on their longer side")
      ->group(group)
      ->check(CLI::Range(16, 16384))
      ->capture_default_str();
}

void declare_networks(CLI::App& app, Options& o) {
  const char* group =
      "Networks (default: slide_depth, slide_inpaint, slide_matte and slide_rim inside this program)";
  const auto network = [&](const char* role, std::string& weights, std::string& model, const char* models) {
    const std::string flag = std::string("--") + role;
    app.add_option(flag + "-weights", weights,
                   std::string("Weights of the ") + role + " network, from slide_convert")
        ->group(group)
        ->type_name("FILE.safetensors");
    app.add_option(flag + "-model", model,
                   std::string("Which network they are for, if the file does not tell: ") + models)
        ->group(group)
        ->type_name("NAME");
  };
  network("depth", o.depth_weights, o.depth_model,
          "slide_depth, depth_anything_v2_vits, "
          "depth_anything_v2_vitb, depth_anything_v2_vitl, midas_v21, midas_v21_small");
  app.add_option(
         "--depth-size", o.depth_size,
         "Pixels that the depth network works at, where not at its authors': of Depth Anything V2 on the "
         "shorter side (518), of the others on the longer (slide_depth, midas_v21 384; small 256)")
      ->group(group)
      ->check(CLI::Range(14, 4096));
  network("inpaint", o.inpaint_weights, o.inpaint_model,
          "slide_inpaint, inpaint_coarse, inpaint_deepfill; fill: none, the depth-aware fill alone");
  network("saliency", o.saliency_weights, o.saliency_model, "slide_matte, u2net, u2netp");
  network("matting", o.matting_weights, o.matting_model,
          "slide_rim, fba, which refine the matte of --matte auto; none: the saliency network's as it is");
}

void declare_output(CLI::App& app, Options& o) {
  const char* group = "Output";
  app.add_option(
         "-o,--output", o.outputs,
         "What to make, by extension; several may be given. .html .glb .ply (points) .gif .png (APNG) .mp4 "
         ".webm .y4m, a "
         "folder "
         "of frames, - for frames on standard output. {} stands for the photo's name. Default: PHOTO.3d.html")
      ->allow_extra_args(false)
      ->group(group)
      ->type_name("FILE");
  app.add_option(
         "--stereo", o.stereo,
         "Make -o a still (.png, .jpg) or a video for two eyes: sbs (side by side), cross (the same for eyes "
         "that cross), tb (left above right), half-sbs or half-tb (squeezed, for television sets) or "
         "anaglyph "
         "(red-cyan). In a video path and eyes have half of --parallax each")
      ->group(group)
      ->check(CLI::IsMember({"sbs", "half-sbs", "cross", "tb", "half-tb", "anaglyph"}));
  app.add_option(
         "--glb-depth", o.glb_depth,
         "Depth of a .glb: relief (shallow, looks right in any viewer) or true (as the camera saw it)")
      ->group(group)
      ->check(CLI::IsMember({"relief", "true"}))
      ->capture_default_str();
  app.add_option("--title", o.title, "Title of a .html. Default: the photo's name")->group(group);
  app.add_option("--alt", o.alt,
                 "What is to be seen, for those to whom a .html is read out. Default: the title")
      ->group(group);
  app.add_option("--layers", o.layers, "Also write the layers and every map into this folder")
      ->group(group)
      ->type_name("DIR");
  app.add_option("--dump-masks", o.dump_masks,
                 "Also write the training masks of the photo: occlusion mask and random strokes, PNG")
      ->group(group)
      ->type_name("DIR");
}

void declare_path(CLI::App& app, Options& o) {
  const char* group = "Camera path";
  app.add_option("--path", o.path, "circle, swing, zoom, dolly-zoom, or a JSON file of poses")
      ->group(group)
      ->type_name("NAME|FILE")
      ->capture_default_str();
  app.add_option(
         "--parallax", o.parallax,
         "How far near moves against far, percent of the photo's width (of a panorama: of twice its height)")
      ->group(group)
      ->check(within(0, 50))
      ->capture_default_str();
  app.add_option("--focus", o.focus, "The disparity that stands still: 0 far, 1 near")
      ->group(group)
      ->check(within(0, 1))
      ->capture_default_str();
  app.add_option("--frames", o.frames, "Frames of the path")
      ->group(group)
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--fps", o.fps, "Frames per second. Default: 30; a GIF has every second frame, at 15")
      ->group(group)
      ->check(within(0.1, 1000));
  app.add_option(
         "--size", o.size,
         "Size of the frames: WIDTHxHEIGHT, or the longer side. Default: the photo's, for a GIF at most 480")
      ->group(group);
  app.add_flag("--keep-edges", o.keep_edges,
               "Do not zoom in to hide the photo's edge where the camera moves past it")
      ->group(group);
}

void declare_geometry(CLI::App& app, Options& o) {
  const char* geometry = "Geometry";
  app.add_option("--near", o.near_depth, "Depth of disparity 1")
      ->group(geometry)
      ->check(within(1e-6, 1e12))
      ->capture_default_str();
  app.add_option("--far", o.far_depth, "Depth of disparity 0")
      ->group(geometry)
      ->check(within(1e-6, 1e12))
      ->capture_default_str();
  app.add_option("--fov", o.fov, "Horizontal field of view in degrees. Default: the photo's EXIF, else 53.13")
      ->group(geometry)
      ->check(within(1, 170));
  const char* layering = "Soft layering (P is the largest parallax in pixels)";
  app.add_option("--beta", o.beta, "Steepness of the visibility. Default: P^2/12")
      ->group(layering)
      ->check(within(0, graphs::kLargestBeta));
  app.add_option("--gamma", o.gamma, "Steepness of the disocclusion. Default: P")
      ->group(layering)
      ->check(within(0, graphs::kLargestGamma));
  app.add_option("--rho", o.rho, "Disparity that a pixel of distance is worth. Default: 1/P")
      ->group(layering)
      ->check(within(0, graphs::kLargestRho));
  app.add_option("--radius", o.radius, "Window of the disocclusion in pixels. Default: P")
      ->group(layering)
      ->check(CLI::Range(0, graphs::kLargestLength));
  app.add_option("--sigma", o.sigma, "Blur of the disparity in pixels")
      ->group(layering)
      ->check(within(0, graphs::kLargestLength))
      ->capture_default_str();
  app.add_option("--maxpool", o.maxpool, "Max-pool of the disparity in pixels, odd")
      ->group(layering)
      ->check(CLI::Range(1, graphs::kLargestLength))
      ->capture_default_str();
}

void declare_running(CLI::App& app, Options& o) {
  const char* drawing = "Drawing";
  app.add_option(
         "--mesh-tolerance", o.mesh_tolerance,
         "Merge triangles where that moves nothing by more than this many pixels; 0: one vertex a pixel")
      ->group(drawing)
      ->check(within(0, 100))
      ->capture_default_str();
  app.add_flag("--supersample", o.supersample, "Average 2x2 samples for each pixel")->group(drawing);
  const char* running = "Running";
  app.add_option("--threads", o.threads, "Threads; 0: one a core")
      ->group(running)
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_option("--isa", o.isa,
                 "Force a lower instruction set: a level (baseline, avx2, avxvnni, avx512, avx512vnni, "
                 "avx512bf16, amx, neon, neondot, neoni8mm, neonbf16), or one without some features "
                 "(avx512bf16,-avx512_vnni; --isa=-avx_vnni)")
      ->group(running)
      ->type_name("LEVEL");
  app.add_option("--max-memory", o.max_memory,
                 "Refuse before any work what needs more memory than this, e.g. 512M")
      ->group(running)
      ->type_name("BYTES");
  app.add_option(
         "--precision", o.precision,
         "What the networks multiply with: fp32, bf16, int8, or auto: the fastest mix within the error "
         "budget. Default: fp32")
      ->group(running)
      ->type_name("NAME");
  app.add_option(
         "--error-budget", o.error_budget,
         "Relative error that each network's result may be expected to have, 1e-7 to 1; the precisions "
         "down to --precision are mixed. Default: 0.01 for auto")
      ->group(running)
      ->type_name("E");
  app.add_flag("--whole-image", o.whole_image,
               "Inpaint the whole image at once instead of the windows with holes")
      ->group(running);
  app.add_flag("--explain", o.explain, "Say what was modelled and what was skipped, with the numbers")
      ->group(running);
  app.add_flag("--plan", o.plan, "Print how the networks would run on this photo, and stop")->group(running);
  app.add_flag("--overwrite", o.overwrite,
               "Replace existing files that SLIDE has not made, too; inputs are never replaced")
      ->group(running);
  app.add_flag("-q,--quiet", o.quiet, "Print nothing but errors")->group(running);
  app.add_flag("--json", o.json, "Print a report as JSON")->group(running);
}

void declare_help(CLI::App& app) {
  app.get_help_ptr()->group("Help");
  add_help_options(app, "slide_run");
}

/// Options that mean something only with another one, or only without it.
void declare_dependencies(CLI::App& app) {
  CLI::Option* const depth = app.get_option("--depth");
  app.get_option("--depth-kind")->needs(depth);
  app.get_option("--depth-edges")->needs(depth);
}

}  // namespace

bool depth_is_file(const Options& options) {
  return !options.depth.empty() && options.depth != kDepthEmbedded && options.depth != kDepthAuto;
}

void declare(CLI::App& app, Options& options) {
  app.description("Turns a photo into a 3D photo.");
  app.footer(kExamples);
  declare_input(app, options);
  declare_output(app, options);
  declare_path(app, options);
  declare_geometry(app, options);
  declare_networks(app, options);
  declare_running(app, options);
  declare_help(app);
  declare_dependencies(app);
}

std::size_t parse_bytes(const std::string& text) {
  const auto wrong = [&] {
    return Error(ErrorKind::kUsage, "'" + text + "' is no amount of memory",
                 "for example 512M, 2G or 1500000");
  };
  std::size_t used = 0;
  double amount = 0;
  try {
    amount = std::stod(text, &used);
  } catch (const std::exception&) {
    throw wrong();
  }
  const std::string unit = text.substr(used);
  if (unit == "K" || unit == "k")
    amount *= 1024;
  else if (unit == "M")
    amount *= 1024.0 * 1024;
  else if (unit == "G")
    amount *= 1024.0 * 1024 * 1024;
  else if (!unit.empty())
    throw wrong();
  if (!(amount >= 1) || amount > 1e18) throw wrong();
  return static_cast<std::size_t>(amount);
}

std::pair<int, int> parse_size(const std::string& text, int photo_width, int photo_height) {
  if (text.empty()) return {photo_width, photo_height};
  const auto wrong = [&] {
    return Error(ErrorKind::kUsage, "'" + text + "' is no size of a frame",
                 "WIDTHxHEIGHT or the longer side, 16 to 16384 pixels");
  };
  const auto number = [&](const std::string& digits) {
    if (digits.empty() || digits.size() > 5 || digits.find_first_not_of("0123456789") != std::string::npos)
      throw wrong();
    const int value = std::stoi(digits);
    if (value < 16 || value > 16384) throw wrong();
    return value;
  };
  if (const std::size_t x = text.find('x'); x != std::string::npos)
    return {number(text.substr(0, x)), number(text.substr(x + 1))};
  const int side = number(text);
  const int longer = std::max(photo_width, photo_height);
  const auto scaled = [&](int extent) {
    return std::max(1, static_cast<int>(std::lround(static_cast<double>(extent) * side / longer)));
  };
  return {scaled(photo_width), scaled(photo_height)};
}

}  // namespace slide::run
