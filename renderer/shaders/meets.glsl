uniform bool straight; // the mesh is taken as flat under each ray, with the same scale for all axes

// Returns whether a ray meets the structure between a front face, where it enters the mesh, and a
// back face, where it leaves the mesh after the distance way. front and back are the distances of
// the MDF from the two faces. If straight is TRUE, the test is that of Wang et al. 2005 §4.1:
// front + back ≤ way. Otherwise the ray meets the structure if front or back is at most half of
// way.
bool meets(float front, float back, float way) {
    return straight ? front + back <= way : min(front, back) <= 0.5 * way;
}
