// Outputs the distance from the eye to the nearest back face.
void main() {
    colour = vec4(distance_from_eye());
}
