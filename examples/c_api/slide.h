/* C API of SLIDE: from a photo to a 3D photo.
 *
 * Every function returns a slide_status. After anything but SLIDE_OK, slide_last_error() has one sentence
 * that says what was wrong and what to do. No C++ exception leaves these functions. One photo may be used by
 * one thread at a time; different photos by different threads.
 *
 * Images are float32, height × width × channels, interleaved, row by row from the top, sRGB-encoded values in
 * [0, 1].
 */
#ifndef SLIDE_SLIDE_H
#define SLIDE_SLIDE_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The same numbers as the exit codes of slide_run. */
typedef enum slide_status {
  SLIDE_OK = 0,
  SLIDE_USAGE = 2,         /* an argument is wrong */
  SLIDE_BAD_INPUT = 3,     /* an image or map is wrong */
  SLIDE_BAD_WEIGHTS = 4,   /* a weight file is wrong */
  SLIDE_OUT_OF_MEMORY = 5, /* memory ran out, or more than memory_limit is needed */
  SLIDE_INTERNAL = 6,      /* a defect of the library */
  SLIDE_OUTPUT = 7,        /* an output could not be written */
  SLIDE_CANCELLED = 130    /* the progress callback asked to stop */
} slide_status;

/* A 3D photo: two layers and a camera. */
typedef struct slide_photo slide_photo;

/* Told how far a stage is (0 to 1); returning 0 stops with SLIDE_CANCELLED. */
typedef int (*slide_progress)(void* user, const char* stage, double part);

typedef struct slide_settings {
  size_t struct_size;          /* set by slide_settings_init() */
  double parallax_percent;     /* of the photo's width, 0 to 50; default 4 */
  double focus;                /* the disparity that stands still, 0 to 1; default 0.5 */
  double fov_degrees;          /* horizontal; 0 (default): EXIF where the photo has it, else 53.13 */
  double near_depth;           /* of disparity 1; default 1 */
  double far_depth;            /* of disparity 0; default 10 */
  int max_side;                /* larger photos are reduced to this, 16 to 16384; default 1536 */
  int frames;                  /* of an animation; default 60 */
  double fps;                  /* 0 (default): 30; a GIF has every second frame, at 15 */
  size_t memory_limit;         /* bytes for a stage; 0 (default): what the process can have */
  const char* depth_weights;   /* a safetensors file; NULL (default): the weights inside the library */
  const char* inpaint_weights; /* likewise; "fill": the depth-aware fill alone, no network */
  const char* precision;       /* "fp32", "bf16", "int8" or "auto"; NULL (default): fp32 */
  double error_budget;     /* relative error that a network's result may be expected to have, the precisions
                              down to that one mixed: 1e-7 to 1; 0 (default): none, for auto 0.01 */
  int overwrite;           /* 1: slide_export() replaces files that it has not made, too; default 0 */
  slide_progress progress; /* NULL (default): none */
  void* user;              /* given to it */
} slide_settings;

/* Fills in the defaults. Call it first, so that fields added later have good values. */
void slide_settings_init(slide_settings* settings);

/* Makes a 3D photo of an image in memory.
 * rgb: height × width × 3. disparity: height × width in any range, larger is nearer, or NULL for the depth
 * network. On success *photo is set; free it with slide_free(). */
slide_status slide_create(const float* rgb, const float* disparity, int width, int height,
                          const slide_settings* settings, slide_photo** photo);

/* The same from an image file (JPEG, PNG, ...). */
slide_status slide_open(const char* path, const slide_settings* settings, slide_photo** photo);

/* Size of the layers: that of the photo unless it was reduced. */
slide_status slide_size(const slide_photo* photo, int* width, int* height);

/* Draws the view from a camera that is moved by (x, y, z) to the right, down and forward, in scene units
 * (near_depth is the depth of the nearest point), without turning. rgb: height × width × 3, written. width
 * and height 0: the photo's. */
slide_status slide_render(slide_photo* photo, double x, double y, double z, int width, int height,
                          float* rgb);

/* Writes the 3D photo, by extension: .html, .glb, .ply, .gif, .png (APNG), .mp4, .webm, .y4m, or a folder of
 * frames. A file that exists and that SLIDE has not made is replaced only with settings.overwrite, else it is
 * SLIDE_USAGE. The photo's own file is never replaced. */
slide_status slide_export(const slide_photo* photo, const char* path);

/* Frees a photo; NULL is fine. */
void slide_free(slide_photo* photo);

/* What went wrong in the last call on this thread; never NULL, valid until the next call. */
const char* slide_last_error(void);

/* "0.1.0" */
const char* slide_version(void);

/* Threads used by all photos of this process; 0: one a core. */
void slide_set_threads(int count);

#ifdef __cplusplus
}
#endif

#endif
