//! The surface of a window, its swapchain, and the presentation of images.
//!
//! Resizing does not wait for the device: a replaced swapchain is kept until the window no longer uses it.

use std::any::Any;
use std::sync::{Arc, atomic::Ordering};

use anyhow::{Context, Result};
use ash::{khr, vk};
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::capabilities::Feature;
use super::commands::Commands;
use super::device::{Device, Shared};
use super::error::{Unavailable, describe};
use super::image::{Image, Texture};
use super::instance::Instance;
use super::semaphores::{Ready, Semaphores, semaphore};
use super::submission::InFlight;

/// The presentation mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Vsync {
    /// One picture at every refresh of the screen, never torn: FIFO.
    On,
    /// Every picture at once; it may be torn: IMMEDIATE.
    Off,
    /// The newest picture at every refresh, never torn: MAILBOX.
    Mailbox,
}

/// The images of a window. It keeps the window alive.
pub struct Swapchain {
    device: Device,
    surface: Arc<Surface>,
    loader: khr::swapchain::Device,
    vsync: Vsync,
    chain: Option<Chain>,
    /// Replaced swapchains, and the number of pictures to show before each can be destroyed.
    retired: Vec<(Arc<RawChain>, u32)>,
    semaphores: Arc<Semaphores>,
}

/// The outcome of asking for an image.
pub enum Acquisition {
    Image(Acquired),
    /// The window has changed: call [`Swapchain::fit`] first.
    Stale,
    /// The window has no pixels: it is minimized.
    Hidden,
    /// The surface is gone: open another.
    Lost,
}

/// An image of a window, to draw into and to pass to [`Commands::present`].
pub struct Acquired {
    image: Image,
    index: u32,
    /// Signalled when the window no longer reads the image.
    ready: Arc<Ready>,
    presentable: vk::Semaphore,
    chain: Arc<RawChain>,
    is_suboptimal: bool,
}

/// The outcome of showing a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Presentation {
    Shown,
    /// The window has changed, and the picture may not be shown: call [`Swapchain::fit`].
    Stale,
    /// The surface is gone: open another.
    Lost,
}

struct Surface {
    raw: vk::SurfaceKHR,
    loader: khr::surface::Instance,
    #[expect(dead_code, reason = "the surface is part of it")]
    window: Arc<dyn Any + Send + Sync>,
    #[expect(dead_code, reason = "the surface is part of it")]
    instance: Arc<Instance>,
}

struct Chain {
    images: Vec<Image>,
    raw: Arc<RawChain>,
    size: [u32; 2],
}

/// The Vulkan swapchain, and one semaphore for each of its images, signalled when the image is drawn.
struct RawChain {
    raw: vk::SwapchainKHR,
    presentable: Vec<vk::Semaphore>,
    loader: khr::swapchain::Device,
    device: Arc<Shared>,
    #[expect(dead_code, reason = "outlives its swapchains")]
    surface: Arc<Surface>,
}

/// More pictures than can be on their way to the screen.
const RETIRED_FOR: u32 = 4;
/// With more retired swapchains than this, resizing waits for the device.
const MOST_RETIRED: usize = 8;

impl Swapchain {
    /// A swapchain for `window`, without images until [`Swapchain::fit`]. The device was opened for the window's
    /// display.
    ///
    /// # Errors
    /// [`Unavailable`] if the device cannot show pictures in this window.
    pub fn new<W>(device: &Device, window: &Arc<W>, vsync: Vsync) -> Result<Self>
    where
        W: HasDisplayHandle + HasWindowHandle + Send + Sync + 'static,
    {
        let shared = &device.0;
        let instance = shared.instance.clone();
        let loader = khr::surface::Instance::new(&instance.entry, &instance.raw);
        let display = window.display_handle().context("the display is gone")?.as_raw();
        let handle = window.window_handle().context("the window is gone")?.as_raw();
        // SAFETY: clause 1: the surface keeps the window and the instance, which has the display's extensions.
        let raw = unsafe { ash_window::create_surface(&instance.entry, &instance.raw, display, handle, None) }
            .map_err(|e| describe("vkCreateSurface", e))?;
        let surface = Arc::new(Surface { raw, loader, window: window.clone(), instance: instance.clone() });
        // SAFETY: clause 1.
        let presents = unsafe {
            surface.loader.get_physical_device_surface_support(
                shared.capabilities.raw,
                shared.capabilities.queue_family,
                raw,
            )
        };
        if !presents.map_err(|e| describe("vkGetPhysicalDeviceSurfaceSupportKHR", e))? {
            return Err(Unavailable(format!("{} cannot show pictures in this window", shared.capabilities.name)).into());
        }
        Ok(Self {
            device: device.clone(),
            surface,
            loader: khr::swapchain::Device::new(&instance.raw, &shared.raw),
            vsync,
            chain: None,
            retired: Vec::new(),
            semaphores: Arc::new(Semaphores::new(shared)),
        })
    }

    pub fn vsync(&self) -> Vsync {
        self.vsync
    }

    /// Takes effect with the next [`Swapchain::fit`].
    pub fn set_vsync(&mut self, vsync: Vsync) {
        self.vsync = vsync;
    }

    /// Width and height of the images in pixels; none while there are no images.
    pub fn size(&self) -> Option<[u32; 2]> {
        self.chain.as_ref().map(|chain| chain.size)
    }

    /// True if shaders can store into the images; else pictures are copied into them.
    pub fn is_stored_directly(&self) -> Result<bool> {
        let capabilities = &self.device.0.capabilities;
        let storable = self.capabilities()?.supported_usage_flags.contains(vk::ImageUsageFlags::STORAGE);
        Ok(storable && capabilities.has(Feature::AnyImageFormat) && self.format_stores()?)
    }

    /// True if the images have blue before red.
    pub fn is_bgra(&self) -> Result<bool> {
        Ok(self.format()?.format == vk::Format::B8G8R8A8_UNORM)
    }

    /// Replaces the images by new ones for the window's present size, or for `size` if the window leaves it open. A
    /// window without pixels gets none.
    ///
    /// # Errors
    /// Any failure other than a lost surface, which is an outcome.
    pub fn fit(&mut self, size: [u32; 2]) -> Result<Presentation> {
        let capabilities = match self.capabilities() {
            Err(error) if is_surface_lost(&error) => return Ok(Presentation::Lost),
            other => other?,
        };
        let current = capabilities.current_extent;
        let [least, most] = [capabilities.min_image_extent, capabilities.max_image_extent];
        let size = match current.width {
            u32::MAX => {
                [size[0].clamp(least.width, most.width.max(1)), size[1].clamp(least.height, most.height.max(1))]
            }
            _ => [current.width, current.height],
        };
        let old = self.chain.take();
        if let Some(old) = &old {
            self.retired.push((old.raw.clone(), RETIRED_FOR));
        }
        if self.retired.len() > MOST_RETIRED {
            self.device.wait_idle()?;
            self.retired.drain(..MOST_RETIRED);
        }
        if size.contains(&0) {
            return Ok(Presentation::Shown);
        }
        match self.chain(size, &capabilities, old.as_ref().map_or(vk::SwapchainKHR::null(), |c| c.raw.raw)) {
            Err(error) if is_surface_lost(&error) => return Ok(Presentation::Lost),
            chain => self.chain = Some(chain?),
        }
        Ok(Presentation::Shown)
    }

    fn chain(&self, size: [u32; 2], capabilities: &vk::SurfaceCapabilitiesKHR, old: vk::SwapchainKHR) -> Result<Chain> {
        let format = self.format()?;
        let direct = self.is_stored_directly()?;
        let usage = vk::ImageUsageFlags::COLOR_ATTACHMENT
            | if direct { vk::ImageUsageFlags::STORAGE } else { vk::ImageUsageFlags::TRANSFER_DST };
        let most = if capabilities.max_image_count == 0 { u32::MAX } else { capabilities.max_image_count };
        let opaque = vk::CompositeAlphaFlagsKHR::OPAQUE;
        let supported = capabilities.supported_composite_alpha;
        let alpha = if supported.contains(opaque) { opaque } else { vk::CompositeAlphaFlagsKHR::INHERIT };
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(self.surface.raw)
            .min_image_count((capabilities.min_image_count + 1).min(most))
            .image_format(format.format)
            .image_color_space(format.color_space)
            .image_extent(vk::Extent2D { width: size[0], height: size[1] })
            .image_array_layers(1)
            .image_usage(usage)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(capabilities.current_transform)
            .composite_alpha(alpha)
            .present_mode(self.mode()?)
            .clipped(true)
            .old_swapchain(old);
        let device = &self.device.0;
        // SAFETY: clauses 1, 3 and 4: only one thread has this object; `raw` below owns the swapchain and frees it on
        // every path.
        let raw =
            unsafe { self.loader.create_swapchain(&info, None) }.map_err(|e| describe("vkCreateSwapchainKHR", e))?;
        let mut raw = RawChain {
            raw,
            presentable: Vec::new(),
            loader: self.loader.clone(),
            device: device.clone(),
            surface: self.surface.clone(),
        };
        // SAFETY: clause 1.
        let images =
            unsafe { self.loader.get_swapchain_images(raw.raw) }.map_err(|e| describe("vkGetSwapchainImagesKHR", e))?;
        for _ in &images {
            raw.presentable.push(semaphore(device)?);
        }
        let raw = Arc::new(raw);
        let image = |handle| {
            let texture = Texture::of_swapchain(device, handle, format.format, size, raw.clone())?;
            Ok(Image { texture: Arc::new(texture) })
        };
        Ok(Chain { images: images.into_iter().map(image).collect::<Result<_>>()?, raw, size })
    }

    /// Takes the next image to draw into. Waits until the window has a free one.
    ///
    /// # Errors
    /// Any failure other than a stale or lost surface, which are outcomes.
    pub fn acquire(&mut self) -> Result<Acquisition> {
        let Some(chain) = &self.chain else {
            return Ok(Acquisition::Hidden);
        };
        let ready = self.semaphores.take()?;
        // SAFETY: clauses 1 and 3; no submission or acquisition uses the semaphore.
        let acquired = unsafe { self.loader.acquire_next_image(chain.raw.raw, u64::MAX, ready.raw, vk::Fence::null()) };
        let (index, is_suboptimal) = match acquired {
            Ok(acquired) => acquired,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => return Ok(Acquisition::Stale),
            Err(vk::Result::ERROR_SURFACE_LOST_KHR) => return Ok(Acquisition::Lost),
            Err(error) => return Err(describe("vkAcquireNextImageKHR", error)),
        };
        let image = chain.images[index as usize].clone();
        // The old content is discarded: the first command changes the layout again.
        image.texture.is_general.store(false, Ordering::Relaxed);
        let presentable = chain.raw.presentable[index as usize];
        let chain = chain.raw.clone();
        Ok(Acquisition::Image(Acquired { image, index, ready: Arc::new(ready), presentable, chain, is_suboptimal }))
    }

    fn shown(&mut self) {
        self.retired.iter_mut().for_each(|(_, left)| *left -= 1);
        self.retired.retain(|(_, left)| *left > 0);
    }

    fn capabilities(&self) -> Result<vk::SurfaceCapabilitiesKHR> {
        let (surface, device) = (&self.surface, self.device.0.capabilities.raw);
        // SAFETY: clause 1.
        unsafe { surface.loader.get_physical_device_surface_capabilities(device, surface.raw) }
            .map_err(|e| describe(CAPABILITIES, e))
    }

    /// A format of 8 bits per channel that is shown without conversion.
    fn format(&self) -> Result<vk::SurfaceFormatKHR> {
        let (surface, device) = (&self.surface, self.device.0.capabilities.raw);
        // SAFETY: clause 1.
        let formats = unsafe { surface.loader.get_physical_device_surface_formats(device, surface.raw) }
            .map_err(|e| describe("vkGetPhysicalDeviceSurfaceFormatsKHR", e))?;
        let wanted = [vk::Format::R8G8B8A8_UNORM, vk::Format::B8G8R8A8_UNORM];
        let place = |f: &vk::SurfaceFormatKHR| wanted.iter().position(|wanted| f.format == *wanted);
        let usable = formats.iter().filter(|f| f.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR);
        let best = usable.filter_map(|f| Some((place(f)?, *f))).min_by_key(|(place, _)| *place);
        best.map(|(_, format)| format)
            .ok_or_else(|| Unavailable("this window cannot show pictures of 8 bits per channel".to_owned()).into())
    }

    fn format_stores(&self) -> Result<bool> {
        let (instance, device) = (&self.device.0.instance, self.device.0.capabilities.raw);
        let format = self.format()?.format;
        // SAFETY: clause 1.
        let properties = unsafe { instance.raw.get_physical_device_format_properties(device, format) };
        Ok(properties.optimal_tiling_features.contains(vk::FormatFeatureFlags::STORAGE_IMAGE))
    }

    /// The first supported presentation mode for `vsync`. FIFO is always supported.
    fn mode(&self) -> Result<vk::PresentModeKHR> {
        let (surface, device) = (&self.surface, self.device.0.capabilities.raw);
        // SAFETY: clause 1.
        let modes = unsafe { surface.loader.get_physical_device_surface_present_modes(device, surface.raw) }
            .map_err(|e| describe("vkGetPhysicalDeviceSurfacePresentModesKHR", e))?;
        let wanted: &[_] = match self.vsync {
            Vsync::On => &[],
            Vsync::Off => &[vk::PresentModeKHR::IMMEDIATE, vk::PresentModeKHR::MAILBOX],
            Vsync::Mailbox => &[vk::PresentModeKHR::MAILBOX],
        };
        Ok(wanted.iter().copied().find(|mode| modes.contains(mode)).unwrap_or(vk::PresentModeKHR::FIFO))
    }
}

const CAPABILITIES: &str = "vkGetPhysicalDeviceSurfaceCapabilitiesKHR";

fn is_surface_lost(error: &anyhow::Error) -> bool {
    error.downcast_ref::<vk::Result>() == Some(&vk::Result::ERROR_SURFACE_LOST_KHR)
}

impl Acquired {
    pub fn image(&self) -> &Image {
        &self.image
    }
}

impl Commands {
    /// Ends the recording, submits it and shows the image. The GPU runs the commands after everything submitted before
    /// and after the window no longer reads the image.
    ///
    /// # Errors
    /// As for [`Commands::submit`]; a stale or lost surface is an outcome.
    pub fn present(mut self, swapchain: &mut Swapchain, acquired: Acquired) -> Result<(InFlight, Presentation)> {
        self.make_presentable(&acquired.image);
        self.keep_alive(acquired.ready.clone());
        let in_flight = self.submit_between(Some(acquired.ready.raw), Some(acquired.presentable))?;
        let (waits, chains, indices) = ([acquired.presentable], [acquired.chain.raw], [acquired.index]);
        let info = vk::PresentInfoKHR::default().wait_semaphores(&waits).swapchains(&chains).image_indices(&indices);
        let queue = swapchain.device.0.queue.lock().expect("no holder of the queue panics");
        // SAFETY: clauses 1 and 3; the commands before signal the semaphore.
        let presented = unsafe { swapchain.loader.queue_present(queue.raw, &info) };
        drop(queue);
        swapchain.shown();
        let outcome = match presented {
            Ok(is_suboptimal) if is_suboptimal || acquired.is_suboptimal => Presentation::Stale,
            Ok(_) => Presentation::Shown,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Presentation::Stale,
            Err(vk::Result::ERROR_SURFACE_LOST_KHR) => Presentation::Lost,
            Err(error) => return Err(describe("vkQueuePresentKHR", error)),
        };
        Ok((in_flight, outcome))
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // The last picture may still be on its way to the screen.
        let _ = self.device.wait_idle();
    }
}

impl Drop for RawChain {
    fn drop(&mut self) {
        // SAFETY: clause 2: it retired long enough ago or the device is idle, and none of its images is left.
        unsafe {
            self.loader.destroy_swapchain(self.raw, None);
            self.presentable.iter().for_each(|semaphore| self.device.raw.destroy_semaphore(*semaphore, None));
        }
    }
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: clause 1, its swapchains are gone.
        unsafe { self.loader.destroy_surface(self.raw, None) };
    }
}
