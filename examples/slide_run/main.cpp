// slide_run: a photo becomes a 3D photo.

#include <cstdio>

#include "examples/slide_run/checks.h"
#include "examples/slide_run/job.h"
#include "examples/slide_run/report.h"
#include "examples/slide_run/show_plan.h"
#include "runtime/error.h"
#include "runtime/error_model.h"
#include "runtime/program.h"
#include "runtime/threads.h"

namespace slide::run {
namespace {

/// Runs every photo; one that fails does not stop the others. @return the exit code
int run_all(const Options& o, const std::vector<std::string>& photos) {
  Models models(o);
  ProgressDisplay progress(o.quiet || o.json);
  const Meter meter = [&](const std::string& stage, double part) { progress.show(stage, part); };
  std::vector<JobReport> reports(photos.size());
  int failures = 0;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    JobReport& report = reports[i];
    try {
      run_job(photos[i], photos.size() > 1, o, models, meter, report);
    } catch (...) {  // whatever it is, the other photos are done
      const Failure failure = current_failure();
      report.error = failure.message.find(photos[i]) == std::string::npos ? photos[i] + ": " + failure.message
                                                                          : failure.message;
      report.exit_code = exit_code(failure.kind);
    }
    progress.clear();
    failures += report.error.empty() ? 0 : 1;
    if (!report.error.empty())
      std::fprintf(stderr, "slide_run: %s\n", report.error.c_str());
    else if (!o.quiet && !o.json && !o.plan)
      print_summary(report, o.explain);
  }
  if (o.json) print_json(reports);
  if (photos.size() > 1 && !o.quiet && !o.json)
    std::fprintf(stderr, "%zu photos, %zu done, %d failed\n", photos.size(),
                 photos.size() - static_cast<std::size_t>(failures), failures);
  if (photos.size() == 1) return reports[0].exit_code;
  return failures == 0 ? 0 : 1;
}

void say_what_next(const Options& o, std::size_t photos) {
  if (o.quiet || o.json || o.plan || photos != 1 || !o.outputs.empty()) return;
  std::fprintf(stderr,
               "Open it in a browser and move the mouse. Next: -o photo.gif for an animation, --explain for "
               "the details.\n");
}

int parse_and_run(int argc, char** argv) {
  Options o;
  CLI::App app;
  declare(app, o);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    const int code = app.exit(e);
    return code == 0 ? 0 : exit_code(ErrorKind::kUsage);
  }
  set_thread_count(o.threads);
  if (!o.isa.empty()) set_isa(isa_from_text(o.isa, "--isa"));
  const std::vector<std::string> photos = find_photos(o.inputs);
  check_call(app, o, photos);
  const int code = run_all(o, photos);
  if (code == 0) say_what_next(o, photos.size());
  return code;
}

}  // namespace
}  // namespace slide::run

int main(int argc, char** argv) {
  (void)slide::run::resident_at_start();
  return slide::run_program("slide_run", [&] { return slide::run::parse_and_run(argc, argv); });
}
