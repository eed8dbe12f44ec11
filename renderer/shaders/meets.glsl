uniform bool straight; // the mesh is taken as flat under each ray, with the same scale for all axes

// Returns whether a ray that enters at a front face and leaves through a back face after the
// distance way meets the structure between them. front and back are the distances of the MDF from
// the two ends. With straight, this is the test of Wang et al. 2005 §4.1, front + back ≤ way.
// Otherwise the ray meets the structure if front or back is at most half of way.
bool meets(float front, float back, float way) {
    return straight ? front + back <= way : min(front, back) <= 0.5 * way;
}
