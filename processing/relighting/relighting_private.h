/* The files of this folder share the weights with which lights are predicted. */
#pragma once

#include "relighting.h"
#include "selection/prediction.h"

/* A model that has been fitted to the pictures, with everything that all texels share. */
struct relighting_fit {
    const Relighting *relighting;
    const struct relighting_model *model;
    double sigma;           /* of RBF */
    Prediction *prediction; /* of kriging */
};

/* Computes w_ij for directions of the lights: ret_weights[i + n · j]. Returns FALSE if the lights
 * do not determine the weights. *ret_light then receives the light that cannot be left out. It
 * receives −1 if even all lights together do not determine the terms. */
gboolean relighting_weights(const struct relighting_fit *fit, struct vec3 view,
                            const struct vec3 *lights, int n, double *ret_weights, int *ret_light);
