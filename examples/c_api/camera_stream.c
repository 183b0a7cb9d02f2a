/* Depth of a camera's frames, the network prepared once. Here the "camera" pans over a pattern; put your
 * frames, 8-bit RGB, in its place.
 *   c_camera_stream [frames [width height]] */
#define _POSIX_C_SOURCE 199309L
#include <slide/slide.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* What the library reports of a frame: kept, to see whether anything was prepared for it. */
static void keep_line(void* user, const char* line) {
  char* kept = user;
  strncpy(kept, line, 159);
  kept[159] = '\0';
}

static void next_frame(unsigned char* rgb, int width, int height, int frame) {
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      unsigned char* pixel = rgb + 3 * ((size_t)y * (size_t)width + (size_t)x);
      pixel[0] = (unsigned char)((x + 4 * frame) * 255 / (width + 4 * frame));
      pixel[1] = (unsigned char)(y * 255 / height);
      pixel[2] = ((x + 4 * frame) / 16 + y / 16) % 2 == 0 ? 200 : 60;
    }
}

static slide_status stream(slide_model* model, const char* line, int frames, int width, int height) {
  const size_t pixels = (size_t)width * (size_t)height;
  unsigned char* rgb = malloc(3 * pixels);
  float* map = malloc(sizeof(float) * pixels);
  const slide_image image = {rgb, width, height, 3, SLIDE_UINT8, 0};
  const slide_buffer disparity = {map, width, height, 1, SLIDE_FLOAT32, 0};
  slide_status status = rgb == NULL || map == NULL ? SLIDE_OUT_OF_MEMORY : SLIDE_OK;
  for (int frame = 0; frame < frames && status == SLIDE_OK; ++frame) {
    next_frame(rgb, width, height, frame);
    const double start = now();
    status = slide_disparity(model, &image, &disparity);
    if (status == SLIDE_OK)
      printf("frame %2d: %6.1f ms, disparity in the middle %.3f (%s)\n", frame, 1e3 * (now() - start),
             (double)map[(size_t)(height / 2) * (size_t)width + (size_t)(width / 2)], line);
  }
  free(rgb);
  free(map);
  return status;
}

int main(int argc, char** argv) {
  const int frames = argc > 1 ? atoi(argv[1]) : 30;
  const int width = argc > 3 ? atoi(argv[2]) : 640;
  const int height = argc > 3 ? atoi(argv[3]) : 480;
  char line[160] = "";
  slide_settings settings;
  slide_settings_init(&settings, sizeof settings);
  settings.log = keep_line;
  settings.user = line;
  slide_model* model = NULL;
  slide_status status = slide_model_create(&settings, &model);
  if (status == SLIDE_OK) status = slide_model_prepare(model, width, height);
  if (status == SLIDE_OK) status = stream(model, line, frames, width, height);
  if (status != SLIDE_OK) fprintf(stderr, "c_camera_stream: %s\n", slide_last_error());
  slide_model_free(model);
  return (int)status;
}
