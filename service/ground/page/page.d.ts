interface Window {
  L: any;
}
