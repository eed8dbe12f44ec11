#include "world_private.h"

#define MIN_GRAIN_PX 0.5
#define MAX_REACH_PX 32

/* Returns a random number with variance 1 for a key. It is a sum of four uniform numbers. */
static float white(guint64 key) {
    const guint64 bits = sample_hash(key);
    float sum = -2 * (float)G_MAXUINT16;
    for (int i = 0; i < 64; i += 16)
        sum += (float)(bits >> i & G_MAXUINT16);
    return sum * (1.7320508f / (float)G_MAXUINT16);
}

/* Convolves n values with a kernel. The values are step elements apart in memory. */
static void speckle_smooth(const float *from, int n, gsize step, const float *kernel, int reach,
                           float *ret) {
    for (int i = 0; i < n; i++) {
        float sum = 0;
        for (int k = -reach; k <= reach; k++)
            sum += kernel[k + reach] * from[(gsize)(i + k + reach) * step];
        ret[(gsize)i * step] = sum;
    }
}

/* Speckle with contrast C has an intensity with a gamma distribution of M = 1/C² degrees of freedom
 * (Goodman 2007). Such an intensity is nearly the cube of a normal deviate (Wilson & Hilferty
 * 1931), and is computed in this way. The deviates are correlated over the blur of the lens, so
 * that the grain is as large as the blur. */
void world_speckle(const World *world, int camera, int laser, const struct world_state *state,
                   float *rate) {
    const struct optics_camera *sensor = &world->cameras[camera];
    const double grain = MAX(sensor->blur_px, MIN_GRAIN_PX);
    const int reach = MIN((int)ceil(3.5 * grain), MAX_REACH_PX), across = 2 * reach;
    const int width = sensor->width, height = sensor->height;
    guint64 key = sample_hash(world->noise_seed + (guint64)camera * 64 + (guint64)laser);
    key = sample_hash(key ^ world_bits(state->sweep_deg[laser] + 0.0));
    key = sample_hash(key ^ world_bits(world_relative_rad(state->turntable_deg, 0)));
    key = sample_hash(
        key ^ world_bits(world_relative_rad(world->laser_fixed[laser] ? 0 : state->arc_deg, 0)));
    key ^= world_carried_bits(world->camera_on_arm[camera], state->arm_deg);
    float kernel[2 * MAX_REACH_PX + 1];
    double squares = 0;
    for (int k = -reach; k <= reach; k++) {
        const double value = exp(-k * k / (2 * grain * grain));
        kernel[k + reach] = (float)value;
        squares += value * value;
    }
    for (int k = 0; k <= across; k++)
        kernel[k] /= (float)sqrt(squares);
    const gsize row = (gsize)width + (gsize)across;
    g_autofree float *noise = g_new(float, row *(gsize)(height + across));
    g_autofree float *columns = g_new(float, row *(gsize)height);
    g_autofree float *line = g_new(float, width);
    for (gsize i = 0; i < row * (gsize)(height + across); i++)
        noise[i] = white(key + i * 0x9e3779b97f4a7c15u);
    for (gsize x = 0; x < row; x++)
        speckle_smooth(noise + x, height, row, kernel, reach, columns + x);
    const double spread2 = world->speckle_contrast * world->speckle_contrast / 9;
    for (int y = 0; y < height; y++) {
        speckle_smooth(columns + (gsize)y * row, width, 1, kernel, reach, line);
        for (int x = 0; x < width; x++) {
            const float root = MAX(0, (float)(1 - spread2) + (float)sqrt(spread2) * line[x]);
            rate[y * width + x] *= root * root * root;
        }
    }
}
