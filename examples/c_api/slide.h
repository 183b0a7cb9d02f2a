/* C API of SLIDE: from a photo to a 3D photo.
 *
 *   slide_model   the networks, prepared once and run for photo after photo, or frame after frame of a camera
 *   slide_photo   a 3D photo: two layers, the maps that they come from, and a camera path
 *
 * Errors. Functions that return a slide_status leave their outputs as they were unless it is SLIDE_OK;
 * slide_last_error() then has one sentence that says what was wrong and what to do. No C++ exception leaves
 * these functions, NULL where it is not allowed is SLIDE_USAGE.
 *
 * Threads. There is no state in common: different models and photos may be used by different threads at once.
 * One model, or one photo, is used by one thread at a time. Callbacks come on the thread that made the call.
 *
 * Versions. Structures that begin with struct_size are filled in by their init function and may grow in
 * later versions: a program that was compiled with an older header works with a newer library, and one with a
 * newer header works with an older library as long as it leaves the fields that this lacks zero.
 *
 * Colours are sRGB-encoded, in [0, 1] as floats and 0 to 255 as bytes. Disparity is 1 / distance, normalised
 * to [0, 1]: 1 is nearest.
 */
#ifndef SLIDE_SLIDE_H
#define SLIDE_SLIDE_H

#include <stddef.h>

#if defined(__GNUC__)
#define SLIDE_API __attribute__((visibility("default")))
#else
#define SLIDE_API
#endif

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

typedef struct slide_model slide_model;
typedef struct slide_photo slide_photo;

/* The library's version, "0.2.0". */
SLIDE_API const char* slide_version(void);

/* What went wrong in the last call on this thread, "" if nothing did; never NULL, valid until the next call
 * on this thread. */
SLIDE_API const char* slide_last_error(void);

/* ---- Images ----------------------------------------------------------------------------------------- */

typedef enum slide_type { SLIDE_UINT8 = 0, SLIDE_FLOAT32 = 1 } slide_type;

/* Pixels to read: rows from the top, channels interleaved. The caller keeps them until the call returns. */
typedef struct slide_image {
  const void* data;
  int width, height; /* 1 to 32768 each, at most 2^28 pixels */
  int channels;      /* colours: 3 (RGB), 4 (RGBA, its alpha is not used) or 1 (grey); maps: 1 */
  int type;          /* slide_type */
  size_t row_bytes;  /* from one row to the next; 0: rows follow each other without a gap */
} slide_image;

/* Pixels to write, the caller's as well. Floats are written as they are, bytes rounded and clamped. */
typedef struct slide_buffer {
  void* data;
  int width, height;
  int channels; /* as many as the function writes */
  int type;
  size_t row_bytes; /* likewise; what lies between rows is not touched */
} slide_buffer;

/* ---- Models ----------------------------------------------------------------------------------------- */

/* Told how far a stage is (0 to 1); returning 0 stops the call with SLIDE_CANCELLED. */
typedef int (*slide_progress)(void* user, const char* stage, double part);

/* Told in one line, without an end of line, what a stage took, or what was done to an input. */
typedef void (*slide_log)(void* user, const char* line);

typedef struct slide_settings {
  size_t struct_size;          /* set by slide_settings_init() */
  const char* depth_weights;   /* a safetensors file; NULL (default): the weights inside the library */
  const char* inpaint_weights; /* likewise; "fill": the depth-aware fill alone, no network */
  const char* matte_weights;   /* likewise, of a saliency network */
  const char* precision;       /* "fp32", "bf16", "int8" or "auto"; NULL (default): fp32 */
  double error_budget;         /* relative error that a network's result may be expected to have, precisions
                                  down to that one mixed: 1e-7 to 1; 0 (default): none, for auto 0.01 */
  int depth_side;              /* pixels a side at which the depth network works; 0 (default): its own */
  int max_side;                /* of a 3D photo, larger images are reduced to it: 16 to 16384; default 1536 */
  int threads;                 /* 0 (default): one a core */
  size_t memory_limit;         /* bytes for a stage; 0 (default): what the process can have */
  slide_progress progress;     /* NULL (default): none */
  slide_log log;               /* NULL (default): none */
  void* user;                  /* given to both */
} slide_settings;

/* Fills in the defaults; `size` is sizeof(slide_settings) as the caller was compiled. */
SLIDE_API void slide_settings_init(slide_settings* settings, size_t size);

/* Opens the networks. What they are prepared with is made at the first use for a size, and kept: up to 16
 * preparations, those used last.
 * settings: NULL stands for the defaults; texts are copied. On success *model is set, to be freed with
 * slide_model_free(). SLIDE_BAD_WEIGHTS, SLIDE_USAGE. */
SLIDE_API slide_status slide_model_create(const slide_settings* settings, slide_model** model);

/* Frees a model; NULL is fine. Photos that it has made stay. */
SLIDE_API void slide_model_free(slide_model* model);

/* Makes the first slide_disparity() of that size as fast as the others. */
SLIDE_API slide_status slide_model_prepare(slide_model* model, int width, int height);

/* Depth alone. image: colours. disparity: 1 channel, of the image's size, written.
 * The scale is the image's own: its nearest pixel is 1 and its farthest 0, all are 0 without relief. */
SLIDE_API slide_status slide_disparity(slide_model* model, const slide_image* image,
                                       const slide_buffer* disparity);

/* ---- 3D photos -------------------------------------------------------------------------------------- */

/* One place of the camera. A point X of the scene is seen at rotation · X + translation, x to the right, y
 * down, z forward, in scene units (near_depth is the depth of disparity 1); the photo's own camera is the
 * identity. Projected, in pixels of the photo: centre + shift + zoom · focal · (x, y) / z. */
typedef struct slide_view {
  double rotation[9]; /* by rows */
  double translation[3];
  double zoom;
  double shift[2];
} slide_view;

/* The camera of the photo, moved by (x, y, z) to the right, down and forward without turning. */
SLIDE_API slide_view slide_view_at(double x, double y, double z);

/* What a photo shows, and how the camera will move: layers are made for these views. */
typedef struct slide_scene {
  size_t struct_size; /* set by slide_scene_init() */
  const char* path;   /* "circle", "swing", "zoom", "dolly-zoom" or a file of poses, x.json; NULL (default):
                              circle */
  double parallax_percent; /* of the photo's width (of a panorama: of twice its height), 0 to 50; default 4 */
  double focus;            /* the disparity that stands still, 0 to 1; default 0.5 */
  int frames;              /* of the path; default 60 */
  const slide_view* views; /* a camera path of one's own, instead of the four above; NULL (default): none */
  size_t view_count;
  double fov_degrees; /* horizontal, 1 to 170; 0 (default): EXIF where the photo has it, else 53.13 */
  double near_depth;  /* of disparity 1; default 1 */
  double far_depth;   /* of disparity 0; default 10 */
  int find_subject;   /* 1: a matte of what stands out, by the saliency network; default 0 */
} slide_scene;

SLIDE_API void slide_scene_init(slide_scene* scene, size_t size);

/* Makes a 3D photo of an image in memory.
 * disparity: 1 channel of the image's shape, in any range, larger is nearer; NULL: the depth network. Where its
 * jumps take several pixels they are brought onto the photo's edges.
 * matte: 1 channel, of the subject; NULL: see find_subject.  scene: NULL stands for the defaults.
 * On success *photo is set, to be freed with slide_photo_free(). */
SLIDE_API slide_status slide_make(slide_model* model, const slide_image* image, const slide_image* disparity,
                                  const slide_image* matte, const slide_scene* scene, slide_photo** photo);

/* The same from an image file: JPEG, PNG, and what else the library was built with. */
SLIDE_API slide_status slide_open(slide_model* model, const char* path, const slide_scene* scene,
                                  slide_photo** photo);

/* The same from the bytes of a JPEG or PNG. */
SLIDE_API slide_status slide_decode(slide_model* model, const void* bytes, size_t size,
                                    const slide_scene* scene, slide_photo** photo);

/* Frees a photo; NULL is fine. */
SLIDE_API void slide_photo_free(slide_photo* photo);

/* Size of the layers: that of the image unless it was reduced. */
SLIDE_API slide_status slide_photo_size(const slide_photo* photo, int* width, int* height);

typedef enum slide_map {
  SLIDE_FRONT_COLOUR = 0,         /* 3 channels */
  SLIDE_FRONT_DISPARITY = 1,      /* 1 channel, as all below but the background's colours */
  SLIDE_VISIBILITY = 2,           /* 0: the front layer is see-through */
  SLIDE_BACKGROUND_COLOUR = 3,    /* 3 channels */
  SLIDE_BACKGROUND_DISPARITY = 4, /* at most the front's */
  SLIDE_DISPARITY = 5,            /* as estimated or given, normalised */
  SLIDE_HOLE = 6,                 /* 1 where the background was made up */
  SLIDE_MATTE = 7                 /* of the subject */
} slide_map;

/* 1 if the photo has the map (a slide_map): one without relief has no background, most have no matte. Else 0. */
SLIDE_API int slide_photo_has(const slide_photo* photo, int map);

/* Copies a map; the buffer has the photo's size. SLIDE_USAGE if there is none. */
SLIDE_API slide_status slide_photo_map(const slide_photo* photo, int map, const slide_buffer* out);

/* The camera path, zoomed so that the photo's edge does not show. */
SLIDE_API size_t slide_photo_view_count(const slide_photo* photo);
SLIDE_API slide_status slide_photo_view(const slide_photo* photo, size_t index, slide_view* view);

/* Draws a view in the buffer's size, 3 channels. What the layers were not made for (farther away than the
 * path) shows gaps as stretched surfaces. */
SLIDE_API slide_status slide_render(slide_photo* photo, const slide_view* view, const slide_buffer* out);

/* ---- Files ------------------------------------------------------------------------------------------ */

typedef struct slide_output {
  size_t struct_size; /* set by slide_output_init() */
  int width, height;  /* of frames; 0 (default): the photo's */
  double fps;         /* 0 (default): 30; a GIF has every second frame, at 15 */
  int supersample;    /* 1: average 2×2 samples; default 0 */
  int overwrite;      /* 1: files that SLIDE has not made are replaced, too; default 0 */
  const char* title;  /* of a page; NULL (default): "3D photo" */
  const char* alt;    /* of a page, for screen readers; NULL (default): its title */
  slide_progress progress;
  void* user;
} slide_output;

SLIDE_API void slide_output_init(slide_output* output, size_t size);

/* Writes the 3D photo, by extension: .html, .glb, .ply, .gif, .png (APNG), .mp4, .webm (both through ffmpeg),
 * .y4m, or a folder of frames. A file that exists and that SLIDE has not made is replaced only with
 * `overwrite`, else it is SLIDE_USAGE; the photo's own file never is. output: NULL stands for the defaults. */
SLIDE_API slide_status slide_export(const slide_photo* photo, const char* path, const slide_output* output);

/* Takes the next bytes of an output; returning 0 stops the call with SLIDE_OUTPUT. */
typedef int (*slide_write)(void* user, const void* bytes, size_t size);

/* The same to a function: `format` is one of the extensions above, "html" or ".html". Frames of an animation
 * wait in a file in the folder for temporary files. */
SLIDE_API slide_status slide_encode(const slide_photo* photo, const char* format, const slide_output* output,
                                    slide_write write, void* write_user);

#ifdef __cplusplus
}
#endif

#endif
