interface Window {
  L: any;
  distloc: { look: (lat: number, lon: number, pixelsAKm: number) => object };
}
