/* The parts of neural planes that have another form on a graphics card than in the file.
 * renderer/shaders/neural.glsl reads them. Any thread. */
#pragma once

#include "neural.h"

/* Returns the network as lines “#define NAME value” for neural.glsl. The weights of a layer are a
 * list of matrices, and the biases are a list of vectors. Such constants are about three times as
 * fast on llvmpipe as weights in a uniform block.
 *
 * A matrix is for four rows and four inputs. Each column of the matrix is an input. Matrices of the
 * same rows follow each other. The third layer has eight rows: R, G, B and a row of zeros for the
 * part of the colour with n·l, and then R, G, B and a row of zeros for the part without n·l.
 *
 * The input of a channel of the surface is byte / 255. The first layer includes the scales of the
 * channels. g_free() */
char *neural_shader_network(const struct neural *neural);

/* Gives the values of both planes: 4 layers × NEURAL_PLANE × NEURAL_PLANE × 4 channels. The first
 * two layers are those of halves. */
#define NEURAL_PLANE_LAYERS (2 * NEURAL_PLANE_CHANNELS / 4)
void neural_shader_planes(const struct neural *neural, float *ret);

/* Computes the reflectance under a uniform sky, (1/π) ∫ B dω, as the sum over 16 lights: views ×
 * height × width × R, G, B. Each value is for one point, the end of a ray through the centre of a
 * texel. The views are the middles of NEURAL_SKY × NEURAL_SKY cells of the square of
 * directions.glsl, row by row.
 *
 * If the model has many texels, the values of a coarser mip level are computed. *ret_width and
 * *ret_height are the size of the level that was used. g_free() */
#define NEURAL_SKY 3
float *neural_shader_sky(const struct neural *neural, int *ret_width, int *ret_height);
